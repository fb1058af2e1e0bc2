//! Twin of the binning stages: which tiles a splat must be drawn in, and pairs in depth order.

use std::collections::BTreeSet;

use glam::DVec2;

use crate::shared::{ALPHA_MIN, TILE};

use super::View;
use super::project::Projected;
use super::splat::Hit;

/// Tiles, row-major, with a pixel centre at which the splat's alpha is at least `1 + margin` times
/// the cut. Every pixel in its box is tried.
pub fn tiles(view: &View, s: &Projected, margin: f64) -> BTreeSet<u32> {
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

/// The splat of every pair: each splat of `order` as often as it touches a tile.
pub fn pair_splats(order: &[u32], tile_counts: &[u32]) -> Vec<u32> {
    let each = |&splat: &u32| std::iter::repeat_n(splat, tile_counts[splat as usize] as usize);
    order.iter().flat_map(each).collect()
}
