//! Stage `quantize_rgb8`: the picture in 8 bits, as the topside will have it. If there is a camera's frame, also the
//! frame less the picture, both in 8 bits: `clamp(frame − picture, −128, 127) + 128`.

use crate::shared::{PIXEL, Params, to_byte};
use spirv_std::glam::UVec3;
use spirv_std::spirv;

/// Whether there is a frame.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct Framed {
    /// 1: there is; 0: `frame` and `differences` are not used.
    pub framed: u32,
}

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

/// One invocation per word of four bytes, so that a subgroup writes words that lie side by side: the host's memory may
/// be behind a bus.
#[spirv(compute(threads(256)))]
pub fn quantize_rgb8(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(push_constant)] framed: &Framed,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] image: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] render: &mut [u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] frame: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] differences: &mut [u32],
) {
    let bytes = params.width * params.height * 3;
    let first = id.x * 4;
    if first >= bytes {
        return;
    }
    let mut word = 0;
    let mut k = 0;
    while k < 4 {
        let byte = first + k;
        if byte < bytes {
            let value = image[(byte / 3 * PIXEL + byte % 3) as usize];
            word |= to_byte(value) << (8 * k);
        }
        k += 1;
    }
    let at = id.x as usize;
    render[at] = word;
    if framed.framed == 1 {
        differences[at] = word_difference(frame[at], word);
    }
}
