//! Stage `project`: mean, conic, colour, depth and tile count of every splat.

use std::mem::offset_of;

use crate::shared::Groups;
use crate::vulkan::{Error, Recorder};

use super::view::{Part, View};
use super::workspace::Workspace;
use super::{Kernels, Scene};

pub(crate) fn record(
    recorder: &mut Recorder,
    kernels: &Kernels,
    scene: &Scene,
    view: &View,
    work: &Workspace,
    part: Part,
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
    let at = part.at(offset_of!(Groups, splats));
    recorder.dispatch_indirect(&kernels.project, &buffers, &[], &view.groups, at)
}
