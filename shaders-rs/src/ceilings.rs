//! Kernels that do one thing alone, as fast as a device can: what the stages are measured against.

use crate::shared::{CEILING_CHAINS, CEILING_STEPS, CEILING_TURNS};
use spirv_std::arch::IndexUnchecked;
use spirv_std::glam::{UVec3, Vec4};
use spirv_std::num_traits::Float;
use spirv_std::spirv;

const _: () = assert!(CEILING_CHAINS == 16 && CEILING_STEPS == 8);

fn step(v: Vec4, scale: f32, offset: f32) -> Vec4 {
    Vec4::new(
        v.x.mul_add(scale, offset),
        v.y.mul_add(scale, offset),
        v.z.mul_add(scale, offset),
        v.w.mul_add(scale, offset),
    )
}

/// Multiply-adds in registers: sixteen chains that do not wait for each other, eight steps of each
/// to a turn of the loop.
#[spirv(compute(threads(256)))]
pub fn ceiling_arithmetic(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] factors: &[f32; 2],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] out: &mut [f32],
) {
    let (scale, offset) = (factors[0], factors[1]);
    let first = id.x as f32;
    let (mut a, mut b) = (Vec4::splat(first), Vec4::splat(first + 1.0));
    let (mut c, mut d) = (Vec4::splat(first + 2.0), Vec4::splat(first + 3.0));
    let apart = Vec4::new(0.0, 0.25, 0.5, 0.75);
    (a, b, c, d) = (a + apart, b + apart, c + apart, d + apart);
    let all = |[a, b, c, d]: [Vec4; 4]| {
        [
            step(a, scale, offset),
            step(b, scale, offset),
            step(c, scale, offset),
            step(d, scale, offset),
        ]
    };
    let mut turn = 0;
    while turn < CEILING_TURNS {
        [a, b, c, d] = all(all(all(all(all(all(all(all([a, b, c, d]))))))));
        turn += 1;
    }
    let sum = a + b + c + d;
    out[id.x as usize] = sum.x + sum.y + sum.z + sum.w;
}

/// Copies words, one an invocation.
#[spirv(compute(threads(256)))]
pub fn ceiling_copy(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] from: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] to: &mut [u32],
) {
    // SAFETY: an invocation a word.
    unsafe { *to.index_unchecked_mut(id.x as usize) = *from.index_unchecked(id.x as usize) };
}
