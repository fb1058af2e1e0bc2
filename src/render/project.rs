//! Stage `project`: mean, conic, colour, depth and tile count of every splat.

use crate::shared::GROUP;
use crate::vulkan::{Error, Recorder};

use super::view::View;
use super::workspace::Workspace;
use super::{Kernels, Scene};

pub(crate) fn record(
    recorder: &mut Recorder,
    kernels: &Kernels,
    scene: &Scene,
    view: &View,
    work: &Workspace,
) -> Result<(), Error> {
    let buffers = [
        &view.params,
        &scene.geometry,
        &scene.sh,
        &work.records,
        &work.tile_counts,
        &work.depth_keys[0],
        &work.depth_order[0],
    ];
    recorder.dispatch(&kernels.project, &buffers, &[], [scene.splats.div_ceil(GROUP), 1, 1])
}
