//! The prefix sum of a workgroup, which binning and sorting use.

use crate::shared::GROUP;
use spirv_std::arch::workgroup_memory_barrier_with_group_sync as barrier;

/// The sum, or the largest number where it would wrap: then the host hears of too many pairs, not
/// of a few.
pub fn saturating(a: u32, b: u32) -> u32 {
    let sum = a.wrapping_add(b);
    if sum < a { u32::MAX } else { sum }
}

/// Exclusive prefix sum over the workgroup (Hillis–Steele), and the total; both saturate.
pub fn scan(value: u32, lane: u32, shared: &mut [u32; GROUP as usize]) -> (u32, u32) {
    let lane = lane as usize;
    shared[lane] = value;
    barrier();
    let mut reach = 1;
    while reach < GROUP as usize {
        let mut sum = shared[lane];
        if lane >= reach {
            sum = saturating(sum, shared[lane - reach]);
        }
        barrier();
        shared[lane] = sum;
        barrier();
        reach *= 2;
    }
    (shared[lane] - value, shared[GROUP as usize - 1])
}
