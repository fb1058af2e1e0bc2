//! Stage `arithmetic`: the operations that a portable picture is made of. The host compares them with its own.

use crate::portable::{RESULTS, sample};
use spirv_std::glam::UVec3;
use spirv_std::spirv;

/// One invocation per three numbers.
#[spirv(compute(threads(64)))]
pub fn arithmetic(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] numbers: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] results: &mut [f32],
) {
    let from = (id.x * 3) as usize;
    let values = sample(numbers[from], numbers[from + 1], numbers[from + 2]);
    let to = id.x as usize * RESULTS;
    let mut k = 0;
    while k < RESULTS {
        results[to + k] = values[k];
        k += 1;
    }
}
