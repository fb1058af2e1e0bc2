//! What the render tells of the residual: its own bands.

use crate::Picture;

use super::colour;
use super::geometry::{Geometry, MAX_LEVELS, PLANES};
use super::lifting::{self, Scratch};

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
    row: Vec<i32>,
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
            row: vec![0; 3 * geometry.width],
        }
    }

    /// Transforms a render of the geometry's size.
    pub fn set(&mut self, geometry: &Geometry, render: &Picture, scratch: &mut Scratch) {
        let pixel = |i: usize| std::array::from_fn(|c| i32::from(render.data[3 * i + c]) - GREY);
        let [a, b, c] = &mut self.planes;
        colour::to_planes(pixel, [a, b, c]);
        for (plane, low) in self.planes.iter_mut().zip(&mut self.low) {
            for level in 0..geometry.levels {
                lifting::forward(plane, geometry, level, scratch);
                let (width, height) = geometry.sizes[level + 1];
                let rows = plane.chunks(geometry.width).take(height);
                for (to, row) in low[level + 1].chunks_mut(width.max(1)).zip(rows) {
                    to.copy_from_slice(&row[..width]);
                }
            }
        }
        for (plane, energy) in self.planes.iter().zip(&mut self.energy) {
            box_mean(plane, geometry, &mut self.row, energy);
        }
    }
}

/// Mean magnitude over three by three values; those beyond the edge count as zero.
pub fn box_mean(plane: &[i32], geometry: &Geometry, rows: &mut [i32], into: &mut [i32]) {
    let width = geometry.width;
    rows.fill(0);
    for y in 0..=geometry.height {
        // Sums along row y, in the place of row y − 3.
        let sums = &mut rows[y % 3 * width..][..width];
        match plane.get(y * width..(y + 1) * width).filter(|_| y < geometry.height) {
            Some(row) => {
                for (x, sum) in sums.iter_mut().enumerate() {
                    let from = &row[x.saturating_sub(1)..(x + 2).min(width)];
                    *sum = from.iter().map(|v| v.wrapping_abs()).fold(0, i32::wrapping_add);
                }
            }
            None => sums.fill(0),
        }
        if y > 0 {
            for (x, to) in into[(y - 1) * width..y * width].iter_mut().enumerate() {
                let sum = rows[x].wrapping_add(rows[width + x]).wrapping_add(rows[2 * width + x]);
                *to = sum / 9;
            }
        }
    }
}
