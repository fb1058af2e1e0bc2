//! Stages `bin_count`, `bin_scan`, `bin_emit`: each tile's splats in depth order.

use std::mem::offset_of;

use crate::shared::Groups;
use crate::vulkan::{Error, Recorder};

use super::Kernels;
use super::view::{Part, View};
use super::workspace::Workspace;

pub(crate) fn record(
    recorder: &mut Recorder,
    kernels: &Kernels,
    view: &View,
    work: &Workspace,
    part: Part,
) -> Result<(), Error> {
    let split = [view.binning.log_blocks];
    let blocks = part.at(offset_of!(Groups, bin_blocks));
    let bands_at = part.at(offset_of!(Groups, bands));
    let (r, groups) = (recorder, &view.groups);
    let (params, counters, starts) = (&view.params, &work.counters, &view.binning.starts);
    let (order, records, bands) = (&work.order, &work.records, &view.bands);
    let buffers = [params, counters, order, records, starts];
    r.dispatch_indirect(&kernels.bin_count, &buffers, &split, groups, blocks)?;
    let buffers = [params, starts, bands];
    r.dispatch_indirect(&kernels.bin_scan, &buffers, &split, groups, bands_at)?;
    let (ranges, pairs) = (&view.ranges, &work.pair_splats);
    let buffers = [params, counters, order, records, starts, bands, ranges, pairs];
    r.dispatch_indirect(&kernels.bin_emit, &buffers, &split, groups, blocks)
}
