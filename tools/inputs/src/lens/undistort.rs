//! Pictures of a lens as pictures of a pinhole camera.
//!
//! Each new pixel is a square on the pinhole's picture, and very nearly a parallelogram on the
//! lens's: its footprint. The new pixel is the mean of the old ones, weighted by Lanczos' kernel of
//! three lobes along both of the footprint's sides. So undistorting and reducing are one step: the
//! kernel grows with the footprint and lets no frequency through that the new size cannot hold. If
//! a footprint is smaller than an old pixel, the kernel is as wide as that pixel, and interpolates.
//! Without distortion this is the filter by which [`crate::frame_file::read_frame`] resizes.

use std::ops::RangeInclusive;

use glam::{DMat2, DVec2, Vec2};
use nvsprior::{Camera, Picture};

use super::{Lens, LensError};

/// A truth value for each pixel of a picture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mask {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// `width · height` values, row-major: which pixels count.
    pub data: Vec<bool>,
}

impl Mask {
    /// The mask of this size by which all pixels count.
    pub fn all(width: u32, height: u32) -> Mask {
        Mask { width, height, data: vec![true; width as usize * height as usize] }
    }

    /// The share of pixels that count, in [0, 1].
    pub fn share(&self) -> f64 {
        let count = self.data.iter().filter(|counts| **counts).count();
        count as f64 / self.data.len().max(1) as f64
    }
}

/// Lobes of the kernel to either side.
const LOBES: f64 = 3.0;

/// Entries of the kernel's table for each unit.
const TABLE_STEP: f32 = 2048.0;

/// Old pixels by which a camera's rounding to f32 may move a pixel off the picture.
const SLACK: f64 = 0.01;

/// Value of a mask's picture from which a pixel counts.
const WHITE: u8 = 128;

/// Where a new pixel lies on the old picture, in old pixels.
#[derive(Clone, Copy)]
struct Footprint {
    centre: DVec2,
    /// Columns: its two sides.
    sides: DMat2,
    /// Whether all of it lies on the old picture.
    whole: bool,
}

impl Footprint {
    /// Its corners: upper left, upper right, lower left, lower right.
    fn new(lens: &Lens, centre: DVec2, corners: [DVec2; 4]) -> Option<Footprint> {
        let [a, b, c, d] = corners;
        let sides = DMat2::from_cols((b - a + d - c) * 0.5, (c - a + d - b) * 0.5);
        // Else the lens mirrors here, or has no resolution.
        let sound = sides.determinant() > 1e-9 && lens.shows(centre, SLACK);
        let whole = corners.iter().all(|corner| lens.shows(*corner, SLACK));
        sound.then_some(Footprint { centre, sides, whole })
    }

    /// Calls `visit` for the old pixels within `reach` of its middle, in units of `sides`: with
    /// their index and their place in those units.
    fn visit(
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
    fn nearest(&self, size: (u32, u32)) -> usize {
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

/// Lanczos' kernel as a table.
struct Kernel(Vec<f32>);

impl Kernel {
    fn new() -> Kernel {
        let sinc = |x: f64| if x == 0.0 { 1.0 } else { x.sin() / x };
        let value = |i: u32| {
            let x = f64::from(i) / f64::from(TABLE_STEP) * std::f64::consts::PI;
            (sinc(x) * sinc(x / LOBES)) as f32
        };
        Kernel((0..=(LOBES as f32 * TABLE_STEP) as u32).map(value).collect())
    }

    /// Zero outside of its lobes.
    fn at(&self, x: f32) -> f32 {
        self.0.get((x.abs() * TABLE_STEP + 0.5) as usize).copied().unwrap_or(0.0)
    }

    /// The weighted mean of a picture's pixels about a footprint.
    fn mean(&self, picture: &Picture, footprint: &Footprint) -> [u8; 3] {
        // A kernel narrower than an old pixel would miss them all.
        let widened = |side: DVec2| side / side.length().min(1.0);
        let sides = footprint.sides;
        let sides = DMat2::from_cols(widened(sides.x_axis), widened(sides.y_axis));
        let size = (picture.width, picture.height);
        let (mut sum, mut weights) = ([0.0f32; 3], 0.0f32);
        footprint.visit(sides, LOBES, size, |index, place| {
            let weight = self.at(place.x) * self.at(place.y);
            for (sum, value) in sum.iter_mut().zip(&picture.data[3 * index..3 * index + 3]) {
                *sum += weight * f32::from(*value);
            }
            weights += weight;
        });
        if weights > 1e-3 {
            return sum.map(|sum| (sum / weights).round() as u8);
        }
        let index = 3 * footprint.nearest(size);
        std::array::from_fn(|channel| picture.data[index + channel])
    }
}

impl Lens {
    /// Undistorts a picture of this lens and brings it to a camera's size in one step.
    ///
    /// The mask holds the pixels all of which lies on the old picture. The others hold its last
    /// pixels if their centres lie on it, else black. Errors: the picture is of another size than
    /// the lens, or `to` cannot be rendered.
    pub fn undistort(&self, picture: &Picture, to: &Camera) -> Result<(Picture, Mask), LensError> {
        let samples = 3 * u64::from(picture.width) * u64::from(picture.height);
        self.check_sizes(
            (picture.width, picture.height),
            picture.data.len() as u64 == samples,
            to,
        )?;
        let kernel = Kernel::new();
        let mut new = Picture::new(to.width, to.height);
        let mut mask = Mask { data: vec![false; to.pixels()], ..Mask::all(to.width, to.height) };
        self.each_footprint(to, |index, footprint| {
            let mean = kernel.mean(picture, &footprint);
            new.data[3 * index..3 * index + 3].copy_from_slice(&mean);
            mask.data[index] = footprint.whole;
        });
        Ok((new, mask))
    }

    /// The mask of the undistorted picture: those pixels count all of which lies on the old picture
    /// and on white. `grey` has a byte for each of the lens's pixels, white from 128.
    pub fn undistort_mask(&self, grey: &[u8], to: &Camera) -> Result<Mask, LensError> {
        let size = (self.intrinsics.width, self.intrinsics.height);
        let pixels = u64::from(size.0) * u64::from(size.1);
        self.check_sizes(size, grey.len() as u64 == pixels, to)?;
        let mut mask = Mask { data: vec![false; to.pixels()], ..Mask::all(to.width, to.height) };
        self.each_footprint(to, |index, footprint| {
            let mut white = footprint.whole && grey[footprint.nearest(size)] >= WHITE;
            if white {
                let visit = |index: usize, _| white &= grey[index] >= WHITE;
                footprint.visit(footprint.sides, 0.5, size, visit);
            }
            mask.data[index] = white;
        });
        Ok(mask)
    }

    fn check_sizes(&self, found: (u32, u32), full: bool, to: &Camera) -> Result<(), LensError> {
        to.check()?;
        let expected = (self.intrinsics.width, self.intrinsics.height);
        if found != expected || !full {
            return Err(LensError::Size { found, expected });
        }
        Ok(())
    }

    /// Calls `visit` with the index and footprint of each of the camera's pixels that shows
    /// something of the picture.
    fn each_footprint(&self, to: &Camera, mut visit: impl FnMut(usize, Footprint)) {
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
