//! Stages `bin_count`, `bin_scan`, `bin_emit`: (tile, splat) pairs in depth order.

use std::mem::offset_of;

use crate::shared::Groups;
use crate::vulkan::{Error, Recorder};

use super::Kernels;
use super::view::{Part, View};
use super::workspace::Workspace;

/// `order`: which of the two depth orders is sorted.
pub(crate) fn record(
    recorder: &mut Recorder,
    kernels: &Kernels,
    view: &View,
    work: &Workspace,
    order: usize,
    part: Part,
) -> Result<(), Error> {
    let blocks = part.at(offset_of!(Groups, bin_blocks));
    let one = part.at(offset_of!(Groups, one));
    let groups = &view.groups;
    let order = &work.depth_order[order];
    let (params, counts, sums) = (&view.params, &work.tile_counts, &work.block_sums);
    recorder.dispatch_indirect(
        &kernels.bin_count,
        &[params, order, counts, sums],
        &[],
        groups,
        blocks,
    )?;
    let buffers = [params, sums, &work.counters];
    recorder.dispatch_indirect(&kernels.bin_scan, &buffers, &[], groups, one)?;
    let (tiles, splats) = (&work.pair_tiles[0], &work.pair_splats[0]);
    let buffers = [params, order, counts, sums, &work.records, tiles, splats];
    recorder.dispatch_indirect(&kernels.bin_emit, &buffers, &[], groups, blocks)
}
