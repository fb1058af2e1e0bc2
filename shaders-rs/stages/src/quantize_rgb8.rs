//! Stage `quantize_rgb8`: the picture in 8 bits, as the topside will have it.

use crate::shared::{PIXEL, Params, to_byte};
use spirv_std::glam::UVec3;
use spirv_std::spirv;

/// One invocation per four pixels, which are three words of bytes.
#[spirv(compute(threads(256)))]
pub fn quantize_rgb8(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] image: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] render: &mut [u32],
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
}
