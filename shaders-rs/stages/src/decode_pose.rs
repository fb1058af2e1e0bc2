//! Stage `decode_pose`: sets the camera of the full picture to the pose of a packet. Encoder and decoder both draw
//! after this stage, so they draw at the same pose, bit for bit.

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
