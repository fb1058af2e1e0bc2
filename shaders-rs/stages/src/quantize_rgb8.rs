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

/// One invocation per four pixels, which are three words of bytes.
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
    let pixels = params.width * params.height;
    let first = id.x * 4;
    if first >= pixels {
        return;
    }
    let mut words = [0; 3];
    let mut k = 0;
    while k < 12 {
        let pixel = first + k / 3;
        if pixel < pixels {
            let value = image[(pixel * PIXEL + k % 3) as usize];
            words[(k / 4) as usize] |= to_byte(value) << (8 * (k % 4));
        }
        k += 1;
    }
    let at = (id.x * 3) as usize;
    render[at] = words[0];
    render[at + 1] = words[1];
    render[at + 2] = words[2];
    if framed.framed == 1 {
        differences[at] = word_difference(frame[at], words[0]);
        differences[at + 1] = word_difference(frame[at + 1], words[1]);
        differences[at + 2] = word_difference(frame[at + 2], words[2]);
    }
}
