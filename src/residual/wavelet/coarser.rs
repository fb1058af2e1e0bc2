//! The decoded coarser picture and the render's, as the contexts of a level look at them.

use std::ops::Range;

use super::frame::Frame;
use super::geometry::Geometry;
use super::lifting::FRACTION;
use crate::coder_tables::PLANES;

/// A plane's first-row sum of grey in the planes' places: what the render's luma lies above.
const GREY_LUMA: i32 = (221 + 12) << FRACTION;

/// What both pictures tell at a level, made once for all of its bands.
pub struct Coarser {
    /// Decoded low band of each plane in steps, with the places of a feature. Its edge is repeated once on every side.
    low: [Vec<i32>; PLANES],
    /// How much brighter the decoded picture is than the render, 8 binary places.
    light: Vec<i32>,
    /// Width of the low band.
    width: usize,
}

/// A place of the decoded picture and the eight around it, row by row.
pub type Around = [[i32; 3]; 3];

/// A lifted value in steps. `factor`: [`super::step::Step::per_unit`].
pub fn in_steps(value: i32, factor: i64) -> i32 {
    let value = (i64::from(value) * factor) >> 16;
    value.clamp(-(1 << 26), 1 << 26) as i32
}

impl Coarser {
    /// For pictures of a size.
    pub fn new(geometry: &Geometry) -> Coarser {
        let (width, height) = geometry.sizes[geometry.levels.min(1)];
        let low = || vec![0; (width + 2) * (height + 2)];
        Coarser {
            low: std::array::from_fn(|_| low()),
            light: vec![0; width * height],
            width: width.max(1),
        }
    }

    /// Takes a level's decoded low band of the first plane, and the render's.
    pub fn set_light(&mut self, frame: &Frame, decoded: &[i32], level: usize) {
        let Frame { geometry, render, .. } = frame;
        let (width, _) = geometry.sizes[level];
        self.width = width.max(1);
        let render = render.low[0][level].chunks(self.width);
        let decoded = decoded.chunks(geometry.width);
        for ((to, luma), decoded) in self.light.chunks_mut(self.width).zip(render).zip(decoded) {
            for ((to, luma), decoded) in to.iter_mut().zip(luma).zip(decoded) {
                *to = light(*luma, *decoded);
            }
        }
    }

    /// Takes a level's decoded low band of a plane.
    pub fn set_low(&mut self, frame: &Frame, decoded: &[i32], level: usize, plane: usize) {
        let geometry = &frame.geometry;
        let (width, height) = geometry.sizes[level];
        self.width = width.max(1);
        let factor = frame.step.per_unit(f64::from(1u32 << level));
        let low = &mut self.low[plane][..(width + 2) * (height + 2)];
        for (y, to) in low.chunks_mut(width + 2).enumerate() {
            let y = y.saturating_sub(1).min(height - 1);
            let row = &decoded[y * geometry.width..y * geometry.width + width];
            for (to, value) in to[1..].iter_mut().zip(row) {
                *to = in_steps(*value, factor);
            }
            (to[0], to[width + 1]) = (to[1], to[width]);
        }
    }

    /// The decoded picture of a plane around a part of a row: the rows above, at and below it, each with a value more
    /// on either side.
    pub fn rows(&self, plane: usize, xs: Range<usize>, y: usize) -> [&[i32]; 3] {
        let stride = self.width + 2;
        [y, y + 1, y + 2].map(|y| &self.low[plane][y * stride..][xs.start..xs.end + 2])
    }

    /// The decoded picture of a plane around a place.
    pub fn around(&self, plane: usize, x: usize, y: usize) -> Around {
        self.rows(plane, x..x + 1, y).map(|row| [row[0], row[1], row[2]])
    }

    /// How much brighter the decoded picture is than the render along a part of a row, 8 binary places. Light that
    /// changes multiplies what is there.
    pub fn light(&self, xs: Range<usize>, y: usize) -> &[i32] {
        &self.light[y * self.width..][xs]
    }
}

fn light(luma: i32, decoded: i32) -> i32 {
    let light = (i64::from(decoded) << 8) / i64::from((luma + GREY_LUMA).max(12 << FRACTION));
    light.clamp(-1024, 1024) as i32
}
