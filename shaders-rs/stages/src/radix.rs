//! Stages `radix_count`, `radix_scatter`: one stable pass of a least-significant-digit radix sort of the depth keys.
//! The keys are split evenly over a fixed number of blocks, so the host need not know how many there are. Each block
//! counts its keys by digit, and then finds from the counts of all where its own go. Stage `project` has counted the
//! first digit. Digits are as narrow as possible: [`shared::DIGITS`] of them just hold the largest key that may be. The
//! first pass leaves out culled splats.

use crate::block_table::BlockTable;
use crate::counters::{self, before};
use crate::lanes::{Lanes, Lockstep, Plain, Scratch, Shared, Table};
use crate::memory::{at, at_mut};
use crate::shared::{self, CULLED, Counters, DIGITS, SORT_STEP};
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
    /// Logarithm, base 2, of the number of blocks that share the keys.
    pub log_blocks: u32,
    /// Keys of the first pass; 0: one for each projected splat. The passes after have the visible splats' alone.
    pub keys: u32,
}

/// The table of counters of a digit of so many bits.
pub fn table(bits: u32, log_blocks: u32, digit: u32) -> BlockTable {
    BlockTable::new(1 << bits, log_blocks, digit, DIGITS)
}

/// A digit of a key.
pub fn digit_of(key: u32, bits: u32, digit: u32) -> u32 {
    (key >> (bits * digit)) & ((1 << bits) - 1)
}

impl Pass {
    /// Keys `[first, end)` of a block.
    pub fn block(&self, counters: &Counters, block: u32) -> [u32; 2] {
        let all = if self.keys > 0 { self.keys } else { counters.splats };
        let keys = if self.first == 1 { all } else { counters.visible };
        shared::block(keys, self.log_blocks, block, SORT_STEP)
    }
}

// Limits of the indices below. Places of keys: below the number of keys. Digits: below TABLE, as
// keys have 32 bits.

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
    let bits = counters.digit_bits;
    let table = table(bits, pass.log_blocks, pass.digit);
    let [first, end] = pass.block(counters, group);
    counters::clear::<L, _>(bins, table.width, lane);
    let mut place = first + lane;
    while place - lane < end {
        let mut key = CULLED;
        if place < end {
            key = at(keys, place);
        }
        L::tally(bins, digit_of(key, bits, pass.digit), 1, key != CULLED, lane, scratch);
        place += L::COUNT;
    }
    counters::leave::<L>(bins, &table, group, lane, histogram);
}

/// Finds the first place of a block's keys of each digit. Returns the number of keys of all blocks.
fn starts<L: Lanes>(
    block: u32,
    lane: u32,
    next: &mut Table,
    scratch: &mut Scratch,
    table: &BlockTable,
    histogram: &[u32],
) -> u32 {
    let mut all_before = 0;
    let mut digit = lane;
    while digit - lane < table.width {
        let [own, all] = before(histogram, table, block, digit.min(table.width - 1));
        let (prefix, total) = L::sum(if digit < table.width { all } else { 0 }, lane, scratch);
        if digit < table.width {
            *at_mut(next, digit) = all_before + prefix + own;
        }
        all_before += total;
        digit += L::COUNT;
    }
    L::sync();
    all_before
}

#[allow(clippy::too_many_arguments)]
fn scatter<L: Lanes>(
    group: u32,
    lane: u32,
    next: &mut Table,
    scratch: &mut Scratch,
    pass: &Pass,
    counters: &mut Counters,
    histogram: &[u32],
    keys: &[u32],
    values: &[u32],
    keys_out: &mut [u32],
    values_out: &mut [u32],
) {
    let bits = counters.digit_bits;
    let table = table(bits, pass.log_blocks, pass.digit);
    let [first, end] = pass.block(counters, group);
    let all = starts::<L>(group, lane, next, scratch, &table, histogram);
    if (pass.first == 1) & (group == 0) & (lane == 0) {
        counters.visible = all;
    }
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
        let digit = digit_of(key, bits, pass.digit);
        let rank =
            L::rank(if kept { digit } else { table.width }, bits + 1, lane, scratch);
        let to = at(next, digit) + rank.before;
        L::sync();
        if kept & rank.last {
            *at_mut(next, digit) = to + 1;
        }
        L::sync();
        if kept {
            if pass.digit + 1 < DIGITS {
                *at_mut(keys_out, to) = key;
            }
            *at_mut(values_out, to) = value;
        }
        place += L::COUNT;
    }
}

/// Makes a form of both stages: entry points, and for each the invocations of a workgroup.
macro_rules! form {
    ($count:ident, $count_threads:tt, $count_lanes:ty, $scatter:ident, $threads:tt, $lanes:ty) => {
        /// Histogram of each block's digits.
        #[spirv(compute(threads($count_threads)))]
        pub fn $count(
            #[spirv(workgroup_id)] group: UVec3,
            #[spirv(local_invocation_index)] lane: u32,
            #[spirv(workgroup)] bins: &mut Table,
            #[spirv(workgroup)] scratch: &mut Scratch,
            #[spirv(push_constant)] pass: &Pass,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] counters: &Counters,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] keys: &[u32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] histogram: &mut [u32],
        ) {
            let counters = *counters;
            count::<$count_lanes>(group.x, lane, bins, scratch, pass, &counters, keys, histogram);
        }

        /// Moves each key and value to its place: after those placed before, by its rank among the invocations with an
        /// equal digit. The first pass also counts the visible splats.
        #[spirv(compute(threads($threads)))]
        pub fn $scatter(
            #[spirv(workgroup_id)] group: UVec3,
            #[spirv(local_invocation_index)] lane: u32,
            #[spirv(workgroup)] next: &mut Table,
            #[spirv(workgroup)] scratch: &mut Scratch,
            #[spirv(push_constant)] pass: &Pass,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] counters: &mut Counters,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] histogram: &[u32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] keys: &[u32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] values: &[u32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] keys_out: &mut [u32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] values_out: &mut [u32],
        ) {
            let g = group.x;
            scatter::<$lanes>(
                g, lane, next, scratch, pass, counters, histogram, keys, values, keys_out,
                values_out,
            );
        }
    };
}

form!(radix_count, 128, Shared<128>, radix_scatter, 32, Plain);
form!(radix_count_lockstep, 8, Lockstep, radix_scatter_lockstep, 8, Lockstep);
