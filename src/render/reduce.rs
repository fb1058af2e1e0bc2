//! Stage `reduce`: the normal equations of the picture, summed over tiles in a fixed order.

use crate::vulkan::{Error, Recorder};

use super::Kernels;
use super::view::View;

pub(crate) fn record(recorder: &mut Recorder, kernels: &Kernels, view: &View) -> Result<(), Error> {
    let buffers = [&view.params, &view.partials, &view.sums];
    recorder.dispatch(&kernels.reduce, &buffers, &[], [1, 1, 1])
}
