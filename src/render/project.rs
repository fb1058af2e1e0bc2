//! Stage `project`: mean, conic, colour and depth key of every splat.

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
    let (geometry, sh) = (&scene.geometry, &scene.sh);
    let buffers = [&view.params, geometry, sh, &work.records, &work.keys, &work.counters];
    // One more for the splat that shows nothing.
    let groups = (scene.splats + 1).div_ceil(GROUP);
    recorder.dispatch(&kernels.project, &buffers, &[], [groups, 1, 1])
}
