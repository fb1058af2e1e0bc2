//! Stage `decode_pose`: puts the camera of the full picture where a packet's pose says. Encoder and decoder
//! both draw after it, so they draw at the same bits.

use crate::search;
use crate::shared::Params;
use crate::solve::Coded;
use spirv_std::spirv;

/// One invocation.
#[spirv(compute(threads(1)))]
pub fn decode_pose(
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] levels: &[Params],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] coded: &Coded,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] params: &mut Params,
) {
    let mut full = levels[0];
    search::set_pose(&mut full, &search::placed(&coded.code, &coded.anchor));
    *params = full;
}
