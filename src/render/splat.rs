//! Stages `splat`, `splat_flow`, `splat_exact`: blending, alone or with a pose Jacobian.

use std::mem::offset_of;

use crate::shared::Groups;
use crate::vulkan::{Error, Recorder};

use super::radix::Fineness;
use super::view::{Part, View};
use super::workspace::Workspace;
use super::{Jacobian, Kernels, Scene, derive, lists};

/// Each tile's share of the normal equations, from the projection on.
pub(crate) fn record_equations(
    recorder: &mut Recorder,
    kernels: &Kernels,
    scene: &Scene,
    view: &View,
    work: &Workspace,
    jacobian: Jacobian,
    fineness: Fineness,
) -> Result<(), Error> {
    let part = Part::First;
    lists::record(recorder, kernels, scene, view, work, fineness, part)?;
    match jacobian {
        Jacobian::Flow => record_flow(recorder, scene, view, work, part),
        Jacobian::Exact => {
            derive::record(recorder, scene, view, work, part)?;
            record_exact(recorder, scene, view, work, part)
        }
    }
}

/// What of a picture is drawn.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Channels {
    /// Colours, depth and transmittance.
    All,
    /// Depth is not.
    Colour,
}

/// The picture.
pub(crate) fn record(
    recorder: &mut Recorder,
    scene: &Scene,
    view: &View,
    work: &Workspace,
    channels: Channels,
    part: Part,
) -> Result<(), Error> {
    let pairs = &work.pair_splats;
    let (params, counters) = (&view.params, &work.counters);
    let buffers = [params, &view.ranges, pairs, &work.records, &view.image, counters];
    let kernel = match channels {
        Channels::All => &scene.kernels.splat,
        Channels::Colour => &scene.kernels.splat_colour,
    };
    let tiles = part.at(offset_of!(Groups, tiles));
    recorder.dispatch_indirect(kernel, &buffers, &[], &view.groups, tiles)
}

/// Each tile's share of the normal equations, from the optical-flow Jacobian.
fn record_flow(
    recorder: &mut Recorder,
    scene: &Scene,
    view: &View,
    work: &Workspace,
    part: Part,
) -> Result<(), Error> {
    let pairs = &work.pair_splats;
    let (params, ranges, counters) = (&view.params, &view.ranges, &work.counters);
    let (frame, partials) = (&view.frame, &view.partials);
    let buffers = [params, ranges, pairs, &work.records, frame, partials, counters];
    let tiles = part.at(offset_of!(Groups, tiles));
    recorder.dispatch_indirect(&scene.kernels.splat_flow, &buffers, &[], &view.groups, tiles)
}

/// Each tile's share of the normal equations, from the exact Jacobian. Nothing where the workspace
/// was made without room for derivatives.
fn record_exact(
    recorder: &mut Recorder,
    scene: &Scene,
    view: &View,
    work: &Workspace,
    part: Part,
) -> Result<(), Error> {
    let Some(derivatives) = &work.derivatives else { return Ok(()) };
    let pairs = &work.pair_splats;
    let (frame, partials) = (&view.frame, &view.partials);
    let (params, ranges, records, counters) =
        (&view.params, &view.ranges, &work.records, &work.counters);
    let buffers = [params, ranges, pairs, records, frame, partials, derivatives, counters];
    let tiles = part.at(offset_of!(Groups, tiles));
    recorder.dispatch_indirect(&scene.kernels.splat_exact, &buffers, &[], &view.groups, tiles)
}
