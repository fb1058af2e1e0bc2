//! Stage `derive`: pose derivatives of every visible splat, for the exact Jacobian.

use crate::shared::GROUP;
use crate::vulkan::{Error, Recorder};

use super::view::View;
use super::workspace::Workspace;
use super::{Kernels, Scene};

/// Nothing where the workspace was made without room for derivatives.
pub(crate) fn record(
    recorder: &mut Recorder,
    kernels: &Kernels,
    scene: &Scene,
    view: &View,
    work: &Workspace,
) -> Result<(), Error> {
    let Some(derivatives) = &work.derivatives else { return Ok(()) };
    let (geometry, sh) = (&scene.geometry, &scene.sh);
    let buffers = [&view.params, geometry, sh, &work.records, &work.keys, derivatives];
    recorder.dispatch(&kernels.derive, &buffers, &[], [(scene.splats + 1).div_ceil(GROUP), 1, 1])
}
