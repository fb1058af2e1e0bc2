//! Stage `pyramid`: one level of the camera's frame, reduced by area averaging, as floats in [0, 1], its light
//! brought to the prior's.

use crate::shared::GROUP;
use spirv_std::glam::UVec3;
use spirv_std::spirv;

/// What to reduce, and where to.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct Reduction {
    /// Width of the frame, pixels.
    pub frame_width: u32,
    /// Side of the block of pixels that becomes one.
    pub factor: u32,
    /// Width of the level, pixels.
    pub width: u32,
    /// Pixels of the level.
    pub pixels: u32,
    /// Where the level's floats begin.
    pub offset: u32,
    /// Bits of 1 / (255 factor²).
    pub scale: u32,
}

/// A byte of a buffer of words.
pub fn byte(words: &[u32], at: u32) -> u32 {
    (words[(at / 4) as usize] >> (8 * (at % 4))) & 0xff
}

/// One invocation a pixel of the level.
#[spirv(compute(threads(256)))]
pub fn pyramid(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(num_workgroups)] groups: UVec3,
    #[spirv(push_constant)] reduction: &Reduction,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] bytes: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] frame: &mut [f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] light: &[f32],
) {
    let pixel = id.y * groups.x * GROUP + id.x;
    if pixel >= reduction.pixels {
        return;
    }
    let factor = reduction.factor;
    let (x, y) = (pixel % reduction.width, pixel / reduction.width);
    let (mut red, mut green, mut blue) = (0, 0, 0);
    let mut row = 0;
    while row < factor {
        let mut at = ((y * factor + row) * reduction.frame_width + x * factor) * 3;
        let end = at + 3 * factor;
        while at < end {
            red += byte(bytes, at);
            green += byte(bytes, at + 1);
            blue += byte(bytes, at + 2);
            at += 3;
        }
        row += 1;
    }
    let scale = f32::from_bits(reduction.scale);
    let to = (reduction.offset + pixel * 3) as usize;
    // Three factors, then three summands.
    frame[to] = red as f32 * scale * light[0] + light[3];
    frame[to + 1] = green as f32 * scale * light[1] + light[4];
    frame[to + 2] = blue as f32 * scale * light[2] + light[5];
}
