//! Stage `reduce`: the normal equations of the picture, summed over tiles in a fixed order.

use std::mem::offset_of;

use crate::shared::Groups;
use crate::vulkan::{Error, Recorder};

use super::Kernels;
use super::view::{Part, View};

pub(crate) fn record(recorder: &mut Recorder, kernels: &Kernels, view: &View) -> Result<(), Error> {
    let buffers = [&view.params, &view.partials, &view.sums];
    let one = Part::First.at(offset_of!(Groups, one));
    recorder.dispatch_indirect(&kernels.reduce, &buffers, &[], &view.groups, one)
}
