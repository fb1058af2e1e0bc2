//! Stages `splat`, `splat_flow`, `splat_exact`: blending, alone or with a pose Jacobian.

use std::mem::offset_of;

use crate::shared::Groups;
use crate::vulkan::{Error, Recorder};

use super::Kernels;
use super::view::{Part, View};
use super::workspace::Workspace;

/// The picture, depth and transmittance.
pub(crate) fn record(
    recorder: &mut Recorder,
    kernels: &Kernels,
    view: &View,
    work: &Workspace,
    part: Part,
) -> Result<(), Error> {
    let pairs = &work.pair_splats;
    let buffers = [&view.params, &view.ranges, pairs, &work.records, &view.image];
    let tiles = part.at(offset_of!(Groups, tiles));
    recorder.dispatch_indirect(&kernels.splat, &buffers, &[], &view.groups, tiles)
}

/// Each tile's share of the normal equations, from the optical-flow Jacobian.
pub(crate) fn record_flow(
    recorder: &mut Recorder,
    kernels: &Kernels,
    view: &View,
    work: &Workspace,
    part: Part,
) -> Result<(), Error> {
    let pairs = &work.pair_splats;
    let buffers = [&view.params, &view.ranges, pairs, &work.records, &view.frame, &view.partials];
    let tiles = part.at(offset_of!(Groups, tiles));
    recorder.dispatch_indirect(&kernels.splat_flow, &buffers, &[], &view.groups, tiles)
}

/// Each tile's share of the normal equations, from the exact Jacobian. Nothing where the workspace
/// was made without room for derivatives.
pub(crate) fn record_exact(
    recorder: &mut Recorder,
    kernels: &Kernels,
    view: &View,
    work: &Workspace,
    part: Part,
) -> Result<(), Error> {
    let Some(derivatives) = &work.derivatives else { return Ok(()) };
    let pairs = &work.pair_splats;
    let (frame, partials) = (&view.frame, &view.partials);
    let buffers = [&view.params, &view.ranges, pairs, &work.records, frame, partials, derivatives];
    let tiles = part.at(offset_of!(Groups, tiles));
    recorder.dispatch_indirect(&kernels.splat_exact, &buffers, &[], &view.groups, tiles)
}
