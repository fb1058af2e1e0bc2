//! Stage `radix_scatter` for full subgroups: each subgroup of a workgroup moves a part of the block's keys by itself.
//! So many loads are under way at once, and a barrier of the workgroup is rare.

use crate::block_table::BlockTable;
use crate::counters::four_before;
use crate::lanes::{Lanes, Scratch, Wave, add};
use crate::memory::{at, at_mut};
use crate::radix::{Pass, digit_of, table};
use crate::shared::{CULLED, Counters, DIGITS, SCATTER_TABLES, SCATTER_TOTALS, TABLE};
use spirv_std::arch::{subgroup_shuffle, workgroup_memory_barrier_with_group_sync as barrier};
use spirv_std::glam::UVec3;
use spirv_std::spirv;

/// Invocations of a workgroup.
const THREADS: u32 = 128;
/// Counters of a workgroup: as many digits as there are, for each subgroup that moves keys.
type Tables = [u32; SCATTER_TABLES as usize];
/// The number of keys in each subgroup's range of digits.
type Totals = [u32; SCATTER_TOTALS as usize];

const _: () = assert!(THREADS / 16 <= SCATTER_TOTALS, "subgroups of 16");
const _: () = assert!(SCATTER_TABLES >= 2 * TABLE, "two subgroups move keys at least");
/// Keys that an invocation loads at once: one after the other, it would wait for each.
const AHEAD: u32 = 4;

/// Who an invocation is.
#[derive(Clone, Copy)]
struct Who<const SUBGROUP: u32> {
    wave: u32,
    lane: u32,
}

impl<const SUBGROUP: u32> Who<SUBGROUP> {
    const WAVES: u32 = THREADS / SUBGROUP;

    fn in_group(self) -> u32 {
        self.wave * SUBGROUP + self.lane
    }
}

/// Keys `[first, end)` that a subgroup moves, and the first of its counters.
#[derive(Clone, Copy)]
struct Part {
    first: u32,
    end: u32,
    /// The most keys that a part of this block has; 0: the block is empty.
    most: u32,
    /// The block's first key.
    any: u32,
    counters: u32,
}

impl Part {
    /// The part of a subgroup. Those after the first `sharers` have an empty one, and no counters.
    fn new<const SUBGROUP: u32>(block: [u32; 2], width: u32, sharers: u32, wave: u32) -> Part {
        let [any, end] = block;
        let most = (end - any).div_ceil(sharers * SUBGROUP) * SUBGROUP;
        let first = if wave < sharers { (any + wave * most).min(end) } else { end };
        Part { first, end: (first + most).min(end), most, any, counters: wave * width }
    }

    /// A place to load from, for one that may be beyond the end. The block must not be empty.
    fn within(&self, place: u32) -> u32 {
        if place < self.end { place } else { self.any }
    }

    /// The keys at four places; beyond the end they are culled.
    fn keys(&self, keys: &[u32], places: [u32; 4]) -> [u32; 4] {
        let [p, q, r, s] = places;
        let (a, b) = (at(keys, self.within(p)), at(keys, self.within(q)));
        let (c, d) = (at(keys, self.within(r)), at(keys, self.within(s)));
        let there = |place: u32, key: u32| if place < self.end { key } else { CULLED };
        [there(p, a), there(q, b), there(r, c), there(s, d)]
    }
}

/// An invocation's next four places.
fn four<const SUBGROUP: u32>(place: u32) -> [u32; 4] {
    [place, place + SUBGROUP, place + 2 * SUBGROUP, place + 3 * SUBGROUP]
}

/// Counts each subgroup's keys by digit.
fn count<const SUBGROUP: u32>(
    who: Who<SUBGROUP>,
    part: &Part,
    pass: &Pass,
    bits: u32,
    keys: &[u32],
    tables: &mut Tables,
) {
    macro_rules! count {
        ($key:expr) => {
            if $key != CULLED {
                add(tables, part.counters + digit_of($key, bits, pass.digit), 1);
            }
        };
    }
    let mut place = part.first + who.lane;
    while place - who.lane < part.end {
        let [a, b, c, d] = part.keys(keys, four::<SUBGROUP>(place));
        count!(a);
        count!(b);
        count!(c);
        count!(d);
        place += AHEAD * SUBGROUP;
    }
}

/// Replaces each subgroup's counts by the places of its first keys. Each subgroup does so for a range of digits, and
/// counts from the first key of its range. Returns the number of keys in the range.
#[allow(clippy::too_many_arguments)]
fn starts<const SUBGROUP: u32>(
    who: Who<SUBGROUP>,
    block: u32,
    sharers: u32,
    range: u32,
    table: &BlockTable,
    histogram: &[u32],
    tables: &mut Tables,
    scratch: &mut Scratch,
) -> u32 {
    let mut all_before = 0;
    macro_rules! start {
        ($at:expr, $counts:expr) => {
            let (at_digit, [own, all]) = ($at, $counts);
            let all = if at_digit < range { all } else { 0 };
            let (prefix, total) = Wave::<SUBGROUP>::sum(all, who.lane, scratch);
            if at_digit < range {
                let mut place = all_before + prefix + own;
                let mut counter = who.wave * range + at_digit;
                while counter < sharers * table.width {
                    let count = at(tables, counter);
                    *at_mut(tables, counter) = place;
                    place += count;
                    counter += table.width;
                }
            }
            all_before += total;
        };
    }
    let mut digit = who.lane;
    while digit - who.lane < range {
        let [a, b, c, d] = four::<SUBGROUP>(digit);
        let first = who.wave * range;
        let columns = [first + a, first + b, first + c, first + d];
        let [e, f, g, h] = four_before(histogram, table, block, columns);
        start!(a, e);
        start!(b, f);
        start!(c, g);
        start!(d, h);
        digit += AHEAD * SUBGROUP;
    }
    all_before
}

/// Moves the keys and values of a subgroup to their places. `range_start`: invocation k knows the place of the first
/// key of the k-th range of digits.
#[allow(clippy::too_many_arguments)]
fn place_keys<const SUBGROUP: u32>(
    who: Who<SUBGROUP>,
    part: &Part,
    pass: &Pass,
    bits: u32,
    range: u32,
    range_start: u32,
    keys: &[u32],
    values: &[u32],
    keys_out: &mut [u32],
    values_out: &mut [u32],
    tables: &mut Tables,
    scratch: &mut Scratch,
) {
    // The place of a key among those of all blocks; any, if it is culled.
    macro_rules! place_of {
        ($key:expr) => {{
            let kept = $key != CULLED;
            let digit = digit_of($key, bits, pass.digit);
            let own = if kept { digit } else { 1 << (bits & 31) };
            let rank = Wave::<SUBGROUP>::rank(own, bits + 1, who.lane, scratch);
            let mut to = 0;
            if kept {
                to = at(tables, part.counters + digit) + rank.before;
            }
            Wave::<SUBGROUP>::sync();
            if kept & rank.last {
                *at_mut(tables, part.counters + digit) = to + 1;
            }
            Wave::<SUBGROUP>::sync();
            to + subgroup_shuffle(range_start, digit / range)
        }};
    }
    macro_rules! store {
        ($key:expr, $value:expr, $to:expr) => {
            if $key != CULLED {
                if pass.digit + 1 < DIGITS {
                    *at_mut(keys_out, $to) = $key;
                }
                *at_mut(values_out, $to) = $value;
            }
        };
    }
    // Each subgroup takes as many steps as the one with the most keys. Some drivers (llvmpipe, panfrost, v3d) take a
    // barrier of a subgroup for one of the workgroup, which all must reach equally often.
    let mut step = 0;
    while step < part.most {
        let places = four::<SUBGROUP>(part.first + step + who.lane);
        let [a, b, c, d] = part.keys(keys, places);
        let [mut e, mut f, mut g, mut h] = places;
        if pass.first == 0 {
            (e, f) = (at(values, part.within(e)), at(values, part.within(f)));
            (g, h) = (at(values, part.within(g)), at(values, part.within(h)));
        }
        let (i, j) = (place_of!(a), place_of!(b));
        let (k, l) = (place_of!(c), place_of!(d));
        // All stores at the end: a barrier may wait for those before it.
        store!(a, e, i);
        store!(b, f, j);
        store!(c, g, k);
        store!(d, h, l);
        step += AHEAD * SUBGROUP;
    }
}

#[allow(clippy::too_many_arguments)]
fn scatter<const SUBGROUP: u32>(
    who: Who<SUBGROUP>,
    block: u32,
    tables: &mut Tables,
    totals: &mut Totals,
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
    let sharers = Who::<SUBGROUP>::WAVES.min(SCATTER_TABLES >> (bits & 31));
    let range = table.width / Who::<SUBGROUP>::WAVES;
    let part = Part::new::<SUBGROUP>(pass.block(counters, block), table.width, sharers, who.wave);
    let mut counter = who.in_group();
    while counter < sharers * table.width {
        *at_mut(tables, counter) = 0;
        counter += THREADS;
    }
    barrier();
    count(who, &part, pass, bits, keys, tables);
    barrier();
    let own = starts(who, block, sharers, range, &table, histogram, tables, scratch);
    if who.lane == 0 {
        totals[who.wave as usize] = own;
    }
    barrier();
    let (mut range_start, mut all) = (0, 0);
    let mut other = 0;
    while other < Who::<SUBGROUP>::WAVES {
        let keys = totals[other as usize];
        range_start += if other < who.lane { keys } else { 0 };
        all += keys;
        other += 1;
    }
    if (pass.first == 1) & (block == 0) & (who.in_group() == 0) {
        counters.visible = all;
    }
    place_keys(
        who,
        &part,
        pass,
        bits,
        range,
        range_start,
        keys,
        values,
        keys_out,
        values_out,
        tables,
        scratch,
    );
}

/// Makes the form for subgroups of one size.
macro_rules! form {
    ($name:ident, $subgroup:literal) => {
        /// As `radix::radix_scatter`.
        #[spirv(compute(threads(128)))]
        pub fn $name(
            #[spirv(workgroup_id)] group: UVec3,
            #[spirv(subgroup_id)] wave: u32,
            #[spirv(subgroup_local_invocation_id)] lane: u32,
            #[spirv(workgroup)] tables: &mut Tables,
            #[spirv(workgroup)] totals: &mut Totals,
            #[spirv(workgroup)] scratch: &mut Scratch,
            #[spirv(push_constant)] pass: &Pass,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] counters: &mut Counters,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] histogram: &[u32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] keys: &[u32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] values: &[u32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] keys_out: &mut [u32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] values_out: &mut [u32],
        ) {
            let who = Who::<$subgroup> { wave, lane };
            scatter(
                who, group.x, tables, totals, scratch, pass, counters, histogram, keys, values,
                keys_out, values_out,
            );
        }
    };
}

form!(radix_scatter_wave16, 16);
form!(radix_scatter_wave32, 32);
form!(radix_scatter_wave64, 64);
