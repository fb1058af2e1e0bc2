//! The stages from splats to tile lists, in order: what every picture and every sum begins with.

use crate::vulkan::{Error, Recorder};

use super::radix::{Keys, Sort};
use super::view::{Part, View};
use super::workspace::Workspace;
use super::{Kernels, Scene, bin, project, radix, ranges};

/// Projection, sorting by depth and binning; returns which of the depth orders is sorted. The pairs
/// lie in depth order in the first of the pair buffers.
pub(crate) fn record_pairs(
    recorder: &mut Recorder,
    kernels: &Kernels,
    scene: &Scene,
    view: &View,
    work: &Workspace,
    part: Part,
) -> Result<usize, Error> {
    project::record(recorder, kernels, scene, view, work, part)?;
    let sort = Sort {
        what: Keys::Depth(part),
        passes: radix::passes(u32::MAX),
        counters: &work.counters,
        groups: &view.groups,
        histogram: &work.histogram,
        keys: &work.depth_keys,
        values: &work.depth_order,
    };
    let order = radix::record(recorder, kernels, &sort)?;
    bin::record(recorder, kernels, view, work, order, part)?;
    Ok(order)
}

/// Sorting by tile and the tiles' ranges; returns which of the pair buffers is sorted.
pub(crate) fn record_ranges(
    recorder: &mut Recorder,
    kernels: &Kernels,
    view: &View,
    work: &Workspace,
    part: Part,
) -> Result<usize, Error> {
    let sort = Sort {
        what: Keys::Tile(part),
        // One value more than there are tiles: padding sorts behind the last.
        passes: radix::passes(view.most_tiles() + 1),
        counters: &work.counters,
        groups: &view.groups,
        histogram: &work.histogram,
        keys: &work.pair_tiles,
        values: &work.pair_splats,
    };
    let sorted = radix::record(recorder, kernels, &sort)?;
    ranges::record(recorder, kernels, view, work, sorted)?;
    Ok(sorted)
}
