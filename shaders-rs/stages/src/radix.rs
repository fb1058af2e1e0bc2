//! Stages `radix_count`, `radix_scan`, `radix_scatter`: one stable pass of a least-significant-digit radix sort of the
//! depth keys. The keys are split evenly over a fixed number of workgroups, so the host need not know how many keys
//! there are. Digits are as narrow as possible: [`shared::DIGITS`] of them just hold the largest key. The first pass
//! leaves out culled splats.

use crate::bin::replace_four;
use crate::lanes::{Lanes, Lockstep, Plain, Scan, Scratch, Table, Wave, Waves, Wide};
use crate::memory::{at, at_mut};
use crate::shared::{self, CULLED, Counters};
use spirv_std::glam::UVec3;
use spirv_std::spirv;

/// One pass.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct Pass {
    /// Which digit, from 0, the lowest.
    pub digit: u32,
    /// 1: the first pass. Its values are the places of its keys, and it leaves out culled splats.
    pub first: u32,
    /// Logarithm, base 2, of the number of workgroups that share the keys.
    pub log_blocks: u32,
    /// Keys of the first pass; those after have the visible splats' alone.
    pub keys: u32,
}

impl Pass {
    /// Keys `[first, end)` of a workgroup.
    fn block(&self, counters: &Counters, block: u32, lanes: u32) -> [u32; 2] {
        let keys = if self.first == 1 { self.keys } else { counters.visible };
        shared::block(keys, self.log_blocks, block, lanes)
    }

    /// Lowest bit of the digit, and the number of its values.
    fn digit(&self, counters: &Counters) -> [u32; 2] {
        let bits = shared::digit_bits(counters.largest_key);
        [bits * self.digit, 1 << bits]
    }
}

// Limits of the indices below. Places of keys: below the number of keys. Digits: below TABLE, as
// keys have 32 bits. Rows of the histogram: below the number of blocks.

fn count<L: Lanes>(
    group: u32,
    lane: u32,
    bins: &mut Table,
    scratch: &mut Scratch,
    pass: &Pass,
    counters: &Counters,
    keys: &[u32],
    histogram: &mut [u32],
) {
    let [shift, digits] = pass.digit(counters);
    let [first, end] = pass.block(counters, group, L::COUNT);
    let mut digit = lane;
    while digit < digits {
        *at_mut(bins, digit) = 0;
        digit += L::COUNT;
    }
    L::sync();
    let mut place = first + lane;
    while place - lane < end {
        let mut key = CULLED;
        if place < end {
            key = at(keys, place);
        }
        L::tally(bins, (key >> shift) & (digits - 1), key != CULLED, lane, scratch);
        place += L::COUNT;
    }
    L::sync();
    digit = lane;
    while digit < digits {
        *at_mut(histogram, group * digits + digit) = at(bins, digit);
        digit += L::COUNT;
    }
}

/// Turns the histograms into first positions: by digit, then by block. One workgroup. The number of
/// blocks is a multiple of four; each round takes four, as llvmpipe ends loops after 65,535 rounds.
fn scan<L: Scan>(
    lane: u32,
    scratch: &mut Scratch,
    pass: &Pass,
    counters: &mut Counters,
    histogram: &mut [u32],
) {
    let [_, digits] = pass.digit(counters);
    let end = digits << (pass.log_blocks & 31);
    let mut before = 0;
    let mut digit = lane;
    while digit - lane < digits {
        let mut sum = 0;
        let mut cell = digit;
        while (digit < digits) & (cell < end) {
            sum += at(histogram, cell) + at(histogram, cell + digits);
            sum += at(histogram, cell + 2 * digits) + at(histogram, cell + 3 * digits);
            cell += 4 * digits;
        }
        let (prefix, total) = L::scan(sum, lane, scratch);
        let mut next = before + prefix;
        cell = digit;
        while (digit < digits) & (cell < end) {
            next = replace_four(histogram, cell, digits, next);
            cell += 4 * digits;
        }
        before += total;
        digit += L::COUNT;
    }
    if lane == 0 {
        counters.visible = before;
    }
}

#[allow(clippy::too_many_arguments)]
fn scatter<L: Lanes>(
    group: u32,
    lane: u32,
    next: &mut Table,
    scratch: &mut Scratch,
    pass: &Pass,
    counters: &Counters,
    histogram: &[u32],
    keys: &[u32],
    values: &[u32],
    keys_out: &mut [u32],
    values_out: &mut [u32],
) {
    let [shift, digits] = pass.digit(counters);
    let [first, end] = pass.block(counters, group, L::COUNT);
    let mut digit = lane;
    while digit < digits {
        *at_mut(next, digit) = at(histogram, group * digits + digit);
        digit += L::COUNT;
    }
    L::sync();
    let mut place = first + lane;
    while place - lane < end {
        let mut key = CULLED;
        let mut value = place;
        if place < end {
            key = at(keys, place);
            if pass.first == 0 {
                value = at(values, place);
            }
        }
        let kept = key != CULLED;
        let digit = (key >> shift) & (digits - 1);
        let rank = L::rank(if kept { digit } else { digits }, lane, scratch);
        let to = at(next, digit) + rank.before;
        L::sync();
        if kept & rank.last {
            *at_mut(next, digit) = to + 1;
        }
        L::sync();
        if kept {
            if pass.digit + 1 < shared::DIGITS {
                *at_mut(keys_out, to) = key;
            }
            *at_mut(values_out, to) = value;
        }
        place += L::COUNT;
    }
}

/// Makes a form of the two passes over keys: entry points, invocations of a workgroup, and the built-in number of an
/// invocation.
macro_rules! form {
    ($count:ident, $scatter:ident, $threads:tt, $lanes:ty, $lane:ident) => {
        /// Histogram of each block's digits.
        #[spirv(compute(threads($threads)))]
        pub fn $count(
            #[spirv(workgroup_id)] group: UVec3,
            #[spirv($lane)] lane: u32,
            #[spirv(workgroup)] bins: &mut Table,
            #[spirv(workgroup)] scratch: &mut Scratch,
            #[spirv(push_constant)] pass: &Pass,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] counters: &Counters,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] keys: &[u32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] histogram: &mut [u32],
        ) {
            let counters = *counters;
            count::<$lanes>(group.x, lane, bins, scratch, pass, &counters, keys, histogram);
        }

        /// Moves each key and value to its place: after those placed before, by its rank among the invocations with an
        /// equal digit.
        #[spirv(compute(threads($threads)))]
        pub fn $scatter(
            #[spirv(workgroup_id)] group: UVec3,
            #[spirv($lane)] lane: u32,
            #[spirv(workgroup)] next: &mut Table,
            #[spirv(workgroup)] scratch: &mut Scratch,
            #[spirv(push_constant)] pass: &Pass,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] counters: &Counters,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] histogram: &[u32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] keys: &[u32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] values: &[u32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] keys_out: &mut [u32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] values_out: &mut [u32],
        ) {
            let (g, counters) = (group.x, *counters);
            scatter::<$lanes>(
                g, lane, next, scratch, pass, &counters, histogram, keys, values, keys_out,
                values_out,
            );
        }
    };
}

form!(radix_count, radix_scatter, 32, Plain, local_invocation_index);
form!(radix_count_lockstep, radix_scatter_lockstep, 8, Lockstep, local_invocation_index);
form!(radix_count_wave16, radix_scatter_wave16, 16, Wave<16>, subgroup_local_invocation_id);
form!(radix_count_wave32, radix_scatter_wave32, 32, Wave<32>, subgroup_local_invocation_id);
form!(radix_count_wave64, radix_scatter_wave64, 64, Wave<64>, subgroup_local_invocation_id);

/// Makes a form of the pass over histograms, which one workgroup runs. What follows the type are built-in numbers from
/// which the invocation's is made.
macro_rules! scan_form {
    ($scan:ident, $threads:tt, $lanes:ty, $lane:ident $(, $subgroup:ident)?) => {
        /// Turns the histograms into first positions, and counts the visible splats. One workgroup.
        #[spirv(compute(threads($threads)))]
        pub fn $scan(
            #[spirv($lane)] lane: u32,
            $(#[spirv($subgroup)] $subgroup: u32,)?
            #[spirv(workgroup)] scratch: &mut Scratch,
            #[spirv(push_constant)] pass: &Pass,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] counters: &mut Counters,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] histogram: &mut [u32],
        ) {
            $(let lane = <$lanes>::lane($subgroup, lane);)?
            scan::<$lanes>(lane, scratch, pass, counters, histogram);
        }
    };
}

scan_form!(radix_scan, 256, Wide, local_invocation_index);
scan_form!(radix_scan_lockstep, 8, Lockstep, local_invocation_index);
scan_form!(radix_scan_wave16, 256, Waves<16>, subgroup_local_invocation_id, subgroup_id);
scan_form!(radix_scan_wave32, 256, Waves<32>, subgroup_local_invocation_id, subgroup_id);
scan_form!(radix_scan_wave64, 256, Waves<64>, subgroup_local_invocation_id, subgroup_id);
