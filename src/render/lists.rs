//! The stages from splats to tile lists, in order: what every picture and every sum begins with.

use crate::vulkan::{Error, Recorder};

use super::radix::{Keys, Sort};
use super::view::View;
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
) -> Result<usize, Error> {
    project::record(recorder, kernels, scene, view, work)?;
    recorder.fill(&work.counters, scene.splats);
    let sort = Sort {
        what: Keys::Depth { count: scene.splats },
        passes: radix::passes(u32::MAX),
        counters: &work.counters,
        histogram: &work.histogram,
        keys: &work.depth_keys,
        values: &work.depth_order,
    };
    let order = radix::record(recorder, kernels, &sort)?;
    bin::record(recorder, kernels, scene, view, work, order)?;
    Ok(order)
}

/// Sorting by tile and the tiles' ranges; returns which of the pair buffers is sorted.
pub(crate) fn record_ranges(
    recorder: &mut Recorder,
    kernels: &Kernels,
    view: &View,
    work: &Workspace,
) -> Result<usize, Error> {
    let sort = Sort {
        what: Keys::Tile,
        // One value more than there are tiles: padding sorts behind the last.
        passes: radix::passes(view.tile_count() + 1),
        counters: &work.counters,
        histogram: &work.histogram,
        keys: &work.pair_tiles,
        values: &work.pair_splats,
    };
    let sorted = radix::record(recorder, kernels, &sort)?;
    ranges::record(recorder, kernels, view, work, sorted)?;
    Ok(sorted)
}
