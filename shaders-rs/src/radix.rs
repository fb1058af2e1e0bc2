//! Stages `radix_count`, `radix_scan`, `radix_scatter`: one stable pass of a least-significant-digit
//! radix sort, 8 bits. No subgroup operation takes part, so the order cannot depend on their size.

use crate::scan::scan;
use crate::shared::{Counters, GROUP, RADIX, RADIX_BLOCK, SCATTER_THREADS};
use spirv_std::arch::{atomic_i_add, workgroup_memory_barrier_with_group_sync as barrier};
use spirv_std::glam::UVec3;
use spirv_std::memory::{Scope, Semantics};
use spirv_std::spirv;

/// Which keys (an index into [`Counters::sort`]) and which digit of them.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct Pass {
    /// Index into [`Counters::sort`].
    pub keys: u32,
    /// Lowest bit of the digit.
    pub shift: u32,
}

fn digit(key: u32, pass: &Pass) -> u32 {
    (key >> pass.shift) & (RADIX - 1)
}

/// Histogram of each block's digits.
#[spirv(compute(threads(256)))]
pub fn radix_count(
    #[spirv(workgroup_id)] group: UVec3,
    #[spirv(local_invocation_index)] lane: u32,
    #[spirv(workgroup)] bins: &mut [u32; RADIX as usize],
    #[spirv(push_constant)] pass: &Pass,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] counters: &Counters,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] keys: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] histogram: &mut [u32],
) {
    bins[lane as usize] = 0;
    barrier();
    let count = counters.sort[pass.keys as usize];
    let mut at = group.x * RADIX_BLOCK + lane;
    let end = (group.x + 1) * RADIX_BLOCK;
    while (at < end) & (at < count) {
        let bin = digit(keys[at as usize], pass) as usize;
        // Sums of integers: the same in any order.
        unsafe {
            atomic_i_add::<u32, { Scope::Workgroup as u32 }, { Semantics::NONE.bits() }>(
                &mut bins[bin],
                1,
            );
        }
        at += RADIX;
    }
    barrier();
    histogram[(group.x * RADIX + lane) as usize] = bins[lane as usize];
}

/// Turns the histograms into first positions: by digit, then by block. One workgroup, an invocation a
/// digit.
#[spirv(compute(threads(256)))]
pub fn radix_scan(
    #[spirv(local_invocation_index)] lane: u32,
    #[spirv(workgroup)] totals: &mut [u32; GROUP as usize],
    #[spirv(push_constant)] pass: &Pass,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] counters: &Counters,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] histogram: &mut [u32],
) {
    let blocks = counters.sort[pass.keys as usize].div_ceil(RADIX_BLOCK);
    let mut total = 0;
    let mut block = 0;
    while block < blocks {
        total += histogram[(block * RADIX + lane) as usize];
        block += 1;
    }
    let (mut before, _) = scan(total, lane, totals);
    block = 0;
    while block < blocks {
        let at = (block * RADIX + lane) as usize;
        let here = histogram[at];
        histogram[at] = before;
        before += here;
        block += 1;
    }
}

const RUN: u32 = RADIX_BLOCK / SCATTER_THREADS;
/// Counters of one invocation: 16 bits each, two to a word.
const WORDS: u32 = RADIX / 2;
const TABLE: usize = (WORDS * SCATTER_THREADS) as usize;

/// Moves each key and value to its place. Each invocation ranks a contiguous run of the block: first
/// it counts its digits, then the counts are summed over the invocations before it, then it places.
#[spirv(compute(threads(32)))]
pub fn radix_scatter(
    #[spirv(workgroup_id)] group: UVec3,
    #[spirv(local_invocation_index)] lane: u32,
    #[spirv(workgroup)] table: &mut [u32; TABLE],
    #[spirv(push_constant)] pass: &Pass,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] counters: &Counters,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] histogram: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] keys: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] values: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] keys_out: &mut [u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] values_out: &mut [u32],
) {
    let count = counters.sort[pass.keys as usize];
    let first = group.x * RADIX_BLOCK + lane * RUN;
    let mut end = first + RUN;
    if end > count {
        end = count;
    }
    let mut word = 0;
    while word < WORDS {
        table[(word * SCATTER_THREADS + lane) as usize] = 0;
        word += 1;
    }
    barrier();
    let mut at = first;
    while at < end {
        let d = digit(keys[at as usize], pass);
        table[((d / 2) * SCATTER_THREADS + lane) as usize] += 1 << (16 * (d % 2));
        at += 1;
    }
    barrier();
    sum_over_lanes(lane, table);
    barrier();
    at = first;
    while at < end {
        let key = keys[at as usize];
        let d = digit(key, pass);
        let slot = ((d / 2) * SCATTER_THREADS + lane) as usize;
        let half = 16 * (d % 2);
        let rank = (table[slot] >> half) & 0xffff;
        table[slot] += 1 << half;
        let to = (histogram[(group.x * RADIX + d) as usize] + rank) as usize;
        keys_out[to] = key;
        values_out[to] = values[at as usize];
        at += 1;
    }
}

/// Replaces each count by the sum over the invocations before; two digits to a word at once (a
/// block's sums stay below 2¹⁶).
fn sum_over_lanes(lane: u32, table: &mut [u32; TABLE]) {
    let mut word = lane;
    while word < WORDS {
        let mut before = 0;
        let mut other = 0;
        while other < SCATTER_THREADS {
            let at = (word * SCATTER_THREADS + other) as usize;
            let here = table[at];
            table[at] = before;
            before += here;
            other += 1;
        }
        word += SCATTER_THREADS;
    }
}
