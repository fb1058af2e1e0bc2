//! What the render tells of the residual: its own bands.

use crate::Picture;

use super::colour;
use super::geometry::{Geometry, MAX_LEVELS};
use super::lifting::{self, Scratch};
use crate::coder_tables::PLANES;

/// Grey, from which pixels are counted.
const GREY: i32 = 128;

/// A render's bands, and how far they may be trusted.
pub struct RenderBands {
    /// Transformed planes of the render less grey.
    pub planes: [Vec<i32>; PLANES],
    /// Mean magnitude over a coefficient and its eight neighbours, of the same band or not.
    pub energy: [Vec<i32>; PLANES],
    /// Low band of each plane by level; rows as wide as the band.
    pub low: [[Vec<i32>; MAX_LEVELS + 1]; PLANES],
    /// Room for a few rows.
    rows: Vec<i32>,
}

impl RenderBands {
    /// For pictures of a size.
    pub fn new(geometry: &Geometry) -> RenderBands {
        let plane = || vec![0; geometry.len()];
        let planes = || std::array::from_fn(|_| plane());
        let low = |level: usize| {
            let (width, height) = geometry.sizes[level];
            vec![0; if (1..=geometry.levels).contains(&level) { width * height } else { 0 }]
        };
        RenderBands {
            planes: planes(),
            energy: planes(),
            low: std::array::from_fn(|_| std::array::from_fn(low)),
            rows: vec![0; mean_room(geometry)],
        }
    }

    /// Transforms a render of the geometry's size.
    pub fn set(&mut self, geometry: &Geometry, render: &Picture, scratch: &mut Scratch) {
        let pixels = render.data.as_chunks::<3>().0.iter();
        let levels = pixels.map(|rgb| rgb.map(|level| i32::from(level) - GREY));
        colour::to_planes(levels, &mut self.planes);
        for (plane, low) in self.planes.iter_mut().zip(&mut self.low) {
            for level in 0..geometry.levels {
                lifting::forward(plane, geometry.width, geometry.sizes[level], scratch);
                let (width, height) = geometry.sizes[level + 1];
                let rows = plane.chunks(geometry.width).take(height);
                for (to, row) in low[level + 1].chunks_mut(width.max(1)).zip(rows) {
                    to.copy_from_slice(&row[..width]);
                }
            }
        }
        for (plane, energy) in self.planes.iter().zip(&mut self.energy) {
            box_mean(plane, geometry, &mut self.rows, energy);
        }
    }
}

/// Values that [`box_mean`] needs room for.
pub fn mean_room(geometry: &Geometry) -> usize {
    4 * geometry.width + 2
}

/// Mean magnitude over three by three values; those beyond the edge count as zero. `rows`: of [`mean_room`].
pub fn box_mean(plane: &[i32], geometry: &Geometry, rows: &mut [i32], into: &mut [i32]) {
    let width = geometry.width;
    // Sums along three rows, in turn; and a row's magnitudes between two zeros.
    let (sums, magnitudes) = rows.split_at_mut(3 * width);
    sums.fill(0);
    for y in 0..=geometry.height {
        let sums_here = &mut sums[y % 3 * width..][..width];
        if y < geometry.height {
            let row = &plane[y * width..(y + 1) * width];
            for (to, value) in magnitudes[1..].iter_mut().zip(row) {
                *to = value.wrapping_abs();
            }
            let next = magnitudes[1..].iter().zip(&magnitudes[2..]);
            for (sum, (a, (b, c))) in sums_here.iter_mut().zip(magnitudes.iter().zip(next)) {
                *sum = a.wrapping_add(*b).wrapping_add(*c);
            }
        } else {
            sums_here.fill(0);
        }
        if y > 0 {
            let (first, others) = sums.split_at(width);
            let (second, third) = others.split_at(width);
            let to = into[(y - 1) * width..y * width].iter_mut();
            for (to, (a, (b, c))) in to.zip(first.iter().zip(second.iter().zip(third))) {
                *to = a.wrapping_add(*b).wrapping_add(*c) / 9;
            }
        }
    }
}
