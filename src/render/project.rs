//! Stage `project`: mean, conic, colour and depth key of every splat.

use std::mem::offset_of;

use crate::shared::Groups;
use crate::vulkan::{Error, Recorder};

use super::Scene;
use super::view::{Part, View};
use super::workspace::Workspace;

pub(crate) fn record(
    recorder: &mut Recorder,
    scene: &Scene,
    view: &View,
    work: &Workspace,
    part: Part,
) -> Result<(), Error> {
    let (geometry, sh) = (&scene.geometry, &scene.sh);
    let buffers = [&view.params, geometry, sh, &work.records, &work.keys, &work.counters];
    let at = part.at(offset_of!(Groups, splats));
    recorder.dispatch_indirect(&scene.kernels.project, &buffers, &[], &view.groups, at)
}
