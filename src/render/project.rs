//! Stage `project`: mean, conic, colour and depth key of every splat.

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
    let (geometry, sh) = (&scene.geometry, &scene.sh);
    let buffers = [&view.params, geometry, sh, &work.records, &work.keys, &work.counters];
    let at = part.at(offset_of!(Groups, splats));
    recorder.dispatch_indirect(&kernels.project, &buffers, &[], &view.groups, at)
}
