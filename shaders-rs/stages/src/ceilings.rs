//! Kernels that do only one thing, as fast as a device can. The stages are measured against them.

use crate::shared::{CEILING_CHAINS, CEILING_STEPS, CEILING_TURNS};
use spirv_std::arch::IndexUnchecked;
use spirv_std::glam::{UVec3, Vec4};
use spirv_std::spirv;

const _: () = assert!(CEILING_CHAINS == 16 && CEILING_STEPS == 8);

/// Four chains of four. A step multiplies each by its neighbour, so that no chain can run ahead and wait for its own
/// results.
type Chains = [Vec4; 4];

fn step([a, b, c, d]: Chains, offset: Vec4) -> Chains {
    [a.mul_add(b, offset), b.mul_add(c, offset), c.mul_add(d, offset), d.mul_add(a, offset)]
}

/// Multiply-adds in registers: eight steps of sixteen chains per turn of the loop. With an offset of 0.1 all tend to
/// 0.11, if they begin below 0.8.
#[spirv(compute(threads(256)))]
pub fn ceiling_arithmetic(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] offset: &f32,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] out: &mut [f32],
) {
    let offset = Vec4::splat(*offset);
    let first = Vec4::splat((id.x % 256) as f32 / 512.0);
    let apart = Vec4::new(0.0, 0.001, 0.002, 0.003);
    let mut chains = [first, first + apart, first + apart * 2.0, first + apart * 3.0];
    let mut turn = 0;
    while turn < CEILING_TURNS {
        chains = step(step(step(step(chains, offset), offset), offset), offset);
        chains = step(step(step(step(chains, offset), offset), offset), offset);
        turn += 1;
    }
    let [a, b, c, d] = chains;
    let sum = a + b + c + d;
    out[id.x as usize] = sum.x + sum.y + sum.z + sum.w;
}

/// Copies words, one per invocation.
#[spirv(compute(threads(256)))]
pub fn ceiling_copy(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] from: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] to: &mut [u32],
) {
    // SAFETY: an invocation per word.
    unsafe { *to.index_unchecked_mut(id.x as usize) = *from.index_unchecked(id.x as usize) };
}
