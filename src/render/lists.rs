//! The stages from splats to tile lists, in order: what every picture and every sum begins with.

use crate::vulkan::{Error, Recorder};

use super::radix::{Fineness, Sort};
use super::view::{Part, View};
use super::workspace::Workspace;
use super::{Kernels, Scene, bin, project, radix};

/// Projection, sorting by depth and binning: leaves each tile's splats in depth order.
pub(crate) fn record(
    recorder: &mut Recorder,
    kernels: &Kernels,
    scene: &Scene,
    view: &View,
    work: &Workspace,
    fineness: Fineness,
    part: Part,
) -> Result<(), Error> {
    recorder.fill(&work.counters, 0);
    project::record(recorder, scene, view, work, part)?;
    let sort = Sort {
        fineness,
        count: scene.splats,
        log_blocks: view.log_sort_blocks,
        part,
        groups: &view.groups,
        counters: &work.counters,
        histogram: &work.histogram,
        keys: &work.keys,
        between: &work.between,
        order: &work.order,
    };
    radix::record(recorder, kernels, &sort)?;
    bin::record(recorder, kernels, view, work, part)
}
