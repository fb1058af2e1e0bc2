//! Stage `derive`: pose derivatives of every visible splat, for the exact Jacobian.

use std::mem::offset_of;

use crate::shared::Groups;
use crate::vulkan::{Error, Recorder};

use super::Scene;
use super::view::{Part, View};
use super::workspace::Workspace;

/// Nothing where the workspace was made without room for derivatives.
pub(crate) fn record(
    recorder: &mut Recorder,
    scene: &Scene,
    view: &View,
    work: &Workspace,
    part: Part,
) -> Result<(), Error> {
    let Some(derivatives) = &work.derivatives else { return Ok(()) };
    let (geometry, sh) = (&scene.geometry, &scene.sh);
    let buffers = [&view.params, geometry, sh, &work.records, &work.keys, derivatives];
    let at = part.at(offset_of!(Groups, splats));
    recorder.dispatch_indirect(&scene.kernels.derive, &buffers, &[], &view.groups, at)
}
