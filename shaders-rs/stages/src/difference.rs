//! Stage `difference`: the camera's frame less the render, both in 8 bits: `clamp(frame − render, −128, 127) + 128`.

use crate::shared::Params;
use spirv_std::glam::UVec3;
use spirv_std::spirv;

/// The difference of two words of four bytes each.
fn word_difference(frame: u32, render: u32) -> u32 {
    let mut out = 0;
    let mut shift = 0;
    while shift < 32 {
        let d = ((frame >> shift) & 0xff) as i32 - ((render >> shift) & 0xff) as i32;
        let low = if d > -128 { d } else { -128 };
        let clamped = if low < 127 { low } else { 127 };
        out |= ((clamped + 128) as u32) << shift;
        shift += 8;
    }
    out
}

/// One invocation per four pixels, which are three words of bytes.
#[spirv(compute(threads(256)))]
pub fn difference(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] frame: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] render: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] differences: &mut [u32],
) {
    if id.x * 4 >= params.width * params.height {
        return;
    }
    let at = (id.x * 3) as usize;
    differences[at] = word_difference(frame[at], render[at]);
    differences[at + 1] = word_difference(frame[at + 1], render[at + 1]);
    differences[at + 2] = word_difference(frame[at + 2], render[at + 2]);
}
