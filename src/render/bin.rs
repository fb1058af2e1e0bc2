//! Stages `bin_count`, `bin_scan`, `bin_emit`: (tile, splat) pairs in depth order.

use crate::shared::BIN_BLOCK;
use crate::vulkan::{Error, Recorder};

use super::view::View;
use super::workspace::Workspace;
use super::{Kernels, Scene};

/// `order`: which of the two depth orders is sorted.
pub(crate) fn record(
    recorder: &mut Recorder,
    kernels: &Kernels,
    scene: &Scene,
    view: &View,
    work: &Workspace,
    order: usize,
) -> Result<(), Error> {
    let groups = [scene.splats.div_ceil(BIN_BLOCK), 1, 1];
    let order = &work.depth_order[order];
    let (params, counts, sums) = (&view.params, &work.tile_counts, &work.block_sums);
    recorder.dispatch(&kernels.bin_count, &[params, order, counts, sums], &[], groups)?;
    recorder.dispatch(&kernels.bin_scan, &[params, sums, &work.counters], &[], [1, 1, 1])?;
    let (tiles, splats) = (&work.pair_tiles[0], &work.pair_splats[0]);
    let buffers = [params, order, counts, sums, &work.records, tiles, splats];
    recorder.dispatch(&kernels.bin_emit, &buffers, &[], groups)
}
