//! Where the pixels of a pinhole camera's picture lie on a lens's picture.

use std::ops::RangeInclusive;

use glam::{DMat2, DVec2, Vec2};

use super::{Camera, Lens};

/// Pixels of the lens's picture by which a camera's rounding to f32 may move a pixel off it.
const SLACK: f64 = 0.01;

/// Where a new pixel lies on the old picture, in old pixels.
#[derive(Clone, Copy, Debug)]
pub struct Footprint {
    /// Its middle.
    pub centre: DVec2,
    /// Columns: its two sides.
    pub sides: DMat2,
    /// Whether all of it lies on the old picture.
    pub whole: bool,
}

impl Footprint {
    /// Its corners: upper left, upper right, lower left, lower right.
    fn new(lens: &Lens, centre: DVec2, corners: [DVec2; 4]) -> Option<Footprint> {
        let [a, b, c, d] = corners;
        let sides = DMat2::from_cols((b - a + d - c) * 0.5, (c - a + d - b) * 0.5);
        // Else the lens mirrors here, or has no resolution.
        let valid = sides.determinant() > 1e-9 && lens.shows(centre, SLACK);
        let whole = corners.iter().all(|corner| lens.shows(*corner, SLACK));
        valid.then_some(Footprint { centre, sides, whole })
    }

    /// Calls `visit` for the old pixels within `reach` of its middle, in units of `sides`: with
    /// their index and their place in those units.
    pub fn visit(
        &self,
        sides: DMat2,
        reach: f64,
        size: (u32, u32),
        mut visit: impl FnMut(usize, Vec2),
    ) {
        let inverse = sides.inverse().as_mat2();
        let extent = (sides.x_axis.abs() + sides.y_axis.abs()) * reach;
        let columns = span(self.centre.x, extent.x, size.0);
        for y in span(self.centre.y, extent.y, size.1) {
            let row = y as usize * size.0 as usize;
            let dy = (f64::from(y) + 0.5 - self.centre.y) as f32;
            for x in columns.clone() {
                let dx = (f64::from(x) + 0.5 - self.centre.x) as f32;
                let place = inverse * Vec2::new(dx, dy);
                if place.abs().max_element() <= reach as f32 {
                    visit(row + x as usize, place);
                }
            }
        }
    }

    /// The index of the old pixel under its middle.
    pub fn nearest(&self, size: (u32, u32)) -> usize {
        let x = (self.centre.x.max(0.0) as u32).min(size.0 - 1);
        let y = (self.centre.y.max(0.0) as u32).min(size.1 - 1);
        y as usize * size.0 as usize + x as usize
    }
}

/// The pixels whose centres lie within `extent` of a place, of a row of so many.
fn span(place: f64, extent: f64, length: u32) -> RangeInclusive<u32> {
    // What `as` makes of negative numbers is 0.
    let first = (place - extent - 0.5).ceil() as u32;
    let last = (place + extent - 0.5).floor();
    if last < 0.0 {
        return RangeInclusive::new(1, 0);
    }
    first..=(last as u32).min(length - 1)
}

impl Lens {
    /// Calls `visit` with the index and footprint of each of the camera's pixels that shows
    /// something of the picture.
    pub fn each_footprint(&self, to: &Camera, mut visit: impl FnMut(usize, Footprint)) {
        let (focal, principal) = (DVec2::new(to.fx.into(), to.fy.into()), [to.cx, to.cy]);
        let principal = DVec2::from(principal.map(f64::from));
        let place = |x: f64, y: f64| self.distort((DVec2::new(x, y) - principal) / focal);
        let corners = |y: u32| -> Vec<Option<DVec2>> {
            (0..=to.width).map(|x| place(x.into(), y.into())).collect()
        };
        let mut upper = corners(0);
        for y in 0..to.height {
            let lower = corners(y + 1);
            for x in 0..to.width {
                let at = x as usize;
                let centre = place(f64::from(x) + 0.5, f64::from(y) + 0.5);
                let found = [centre, upper[at], upper[at + 1], lower[at], lower[at + 1]];
                if let [Some(centre), Some(a), Some(b), Some(c), Some(d)] = found
                    && let Some(footprint) = Footprint::new(self, centre, [a, b, c, d])
                {
                    visit(y as usize * to.width as usize + at, footprint);
                }
            }
            upper = lower;
        }
    }
}
