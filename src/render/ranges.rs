//! Stage `ranges`: where each tile's pairs begin and end.

use std::mem::offset_of;

use crate::shared::Counters;
use crate::vulkan::{Error, Recorder};

use super::Kernels;
use super::view::View;
use super::workspace::Workspace;

/// `sorted`: which of the two pair buffers is sorted.
pub(crate) fn record(
    recorder: &mut Recorder,
    kernels: &Kernels,
    view: &View,
    work: &Workspace,
    sorted: usize,
) -> Result<(), Error> {
    recorder.fill(&view.ranges, 0);
    let buffers = [&view.params, &work.counters, &work.pair_tiles[sorted], &view.ranges];
    let offset = offset_of!(Counters, pair_groups) as u64;
    recorder.dispatch_indirect(&kernels.ranges, &buffers, &[], &work.counters, offset)
}
