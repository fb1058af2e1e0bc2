//! Twin of the binning stages: the tiles that a splat must be drawn in, and pairs in depth order.

use std::collections::BTreeSet;

use glam::DVec2;

use nvsprior_kernels::shared::{ALPHA_MIN, TILE};

use super::Viewpoint;
use super::project::Projected;
use super::splat::Hit;

/// Tiles, row-major, with a pixel centre at which the splat's alpha is at least `1 + margin` times
/// the cut. Every pixel in its box is tried.
pub fn tiles(view: &Viewpoint, s: &Projected, margin: f64) -> BTreeSet<u32> {
    let (width, height) = (view.camera.width, view.camera.height);
    let cut = f64::from(ALPHA_MIN) * (1.0 + margin);
    let mut tiles = BTreeSet::new();
    for y in s.rows(height) {
        for x in s.columns(width) {
            let centre = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            if Hit::at(s, view.options, centre).is_some_and(|hit| hit.alpha >= cut) {
                tiles.insert(y / TILE * width.div_ceil(TILE) + x / TILE);
            }
        }
    }
    tiles
}

/// Where each block's part of each tile's list begins, from blocks of `tiles` counts. The last
/// block holds the ends of the lists.
pub fn starts(counts: &[u32], tiles: usize) -> Vec<u32> {
    let blocks = counts.len() / tiles;
    let mut starts = vec![0; counts.len() + tiles];
    let mut next = 0;
    for tile in 0..tiles {
        for block in 0..blocks {
            starts[block * tiles + tile] = next;
            next += counts[block * tiles + tile];
        }
        starts[blocks * tiles + tile] = next;
    }
    starts
}
