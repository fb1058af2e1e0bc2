//! How the invocations of a workgroup exchange values, in three forms of the same meaning. Plain: through shared memory
//! between barriers; works with any subgroup size. Wave: by operations of a full subgroup of 16, 32 or 64. Lockstep:
//! eight invocations that are one vector of a CPU driver (llvmpipe) and run each instruction together. There a shuffle
//! is one instruction, while shared memory goes lane by lane and a barrier saves every register.

use crate::memory::at_mut;
use crate::shared::{LOCKSTEP_TABLE, TABLE, saturating};
use spirv_std::arch::{
    atomic_i_add, control_barrier, subgroup_ballot, subgroup_exclusive_i_add, subgroup_shuffle,
    workgroup_memory_barrier_with_group_sync as barrier,
};
use spirv_std::memory::{Scope, Semantics};

/// Words that each invocation can publish.
pub const SLOTS: u32 = 16;
/// Invocations of a plain workgroup: the subgroup size of most GPUs, so that few wait at a barrier.
pub const PLAIN: u32 = 32;
/// Invocations of a wide workgroup: so many loads are under way even if there is only one workgroup.
pub const WIDE: u32 = 256;
/// Invocations of a lockstep workgroup.
pub const EIGHT: u32 = 8;
/// Shared memory of a plain workgroup.
pub type Scratch = [u32; (SLOTS * PLAIN) as usize];

/// Counters of a workgroup, in shared memory.
pub type Table = [u32; TABLE as usize];
/// Counters of a lockstep workgroup that makes the tiles' lists.
pub type LargeTable = [u32; LOCKSTEP_TABLE as usize];

/// How many invocations before this one hold the same value, and whether this one is the last of them. Only the last
/// one may store.
#[derive(Clone, Copy)]
pub struct Rank {
    pub before: u32,
    pub last: bool,
}

/// A workgroup that adds up counts which may be too many. All calls must be reached by all invocations together.
pub trait Scan {
    /// Its invocations.
    const COUNT: u32;

    /// Exclusive prefix sum, and the total, which saturates; uses slot 0.
    fn scan(value: u32, lane: u32, scratch: &mut Scratch) -> (u32, u32);
}

/// A workgroup whose invocations hand each other values. All calls must be reached by all invocations together.
pub trait Lanes {
    /// Its invocations.
    const COUNT: u32;
    /// Two modules surely compute the same numbers from the same words.
    const REPEATS: bool;

    /// Ends a phase: afterwards what was written to shared memory can be read, and what was read can be written.
    fn sync();

    /// Publishes a value in a slot of the scratch memory, for [`get`](Self::get) in the next phase.
    fn put(value: u32, slot: u32, lane: u32, scratch: &mut Scratch);

    /// The value that the invocation `from` published. `own` is the value that this one published.
    fn get(own: u32, slot: u32, from: u32, scratch: &Scratch) -> u32;

    /// Exclusive prefix sum, and the total, which wrap; uses slot 0.
    fn sum(value: u32, lane: u32, scratch: &mut Scratch) -> (u32, u32);

    /// Rank among equal values of `bits` bits; uses slot 0.
    fn rank(value: u32, bits: u32, lane: u32, scratch: &mut Scratch) -> Rank;

    /// Adds `step`, the same for all, to a counter of each invocation that is `counted`; uses slot 0.
    fn tally<const N: usize>(
        table: &mut [u32; N],
        index: u32,
        step: u32,
        counted: bool,
        lane: u32,
        scratch: &mut Scratch,
    );
}

/// Invocations in subgroups of any size.
pub struct Shared<const COUNT: u32>;

/// 32 of them.
pub type Plain = Shared<PLAIN>;
/// 256 of them.
pub type Wide = Shared<WIDE>;

const _: () = assert!(WIDE <= SLOTS * PLAIN);

impl Scan for Wide {
    const COUNT: u32 = WIDE;

    fn scan(value: u32, lane: u32, scratch: &mut Scratch) -> (u32, u32) {
        scratch[lane as usize] = value;
        barrier();
        let (mut before, mut total) = (0, 0);
        let mut other = 0;
        while other < WIDE {
            let here = scratch[other as usize];
            before += if other < lane { here } else { 0 };
            total = saturating(total, here);
            other += 1;
        }
        barrier();
        (before, total)
    }
}

/// Adds to a counter in shared memory.
pub fn add<const N: usize>(table: &mut [u32; N], index: u32, step: u32) {
    // SAFETY: an atomic on shared memory. The sum of integers is the same in any order.
    unsafe {
        const SCOPE: u32 = Scope::Workgroup as u32;
        atomic_i_add::<u32, SCOPE, { Semantics::NONE.bits() }>(at_mut(table, index), step);
    }
}

impl<const COUNT: u32> Lanes for Shared<COUNT> {
    const COUNT: u32 = COUNT;
    const REPEATS: bool = false;

    fn sync() {
        barrier();
    }

    fn put(value: u32, slot: u32, lane: u32, scratch: &mut Scratch) {
        scratch[(slot * COUNT + lane) as usize] = value;
    }

    fn get(_own: u32, slot: u32, from: u32, scratch: &Scratch) -> u32 {
        scratch[(slot * COUNT + from) as usize]
    }

    fn sum(value: u32, lane: u32, scratch: &mut Scratch) -> (u32, u32) {
        scratch[lane as usize] = value;
        barrier();
        let (mut before, mut total) = (0_u32, 0_u32);
        let mut other = 0;
        while other < COUNT {
            let here = scratch[other as usize];
            before = before.wrapping_add(if other < lane { here } else { 0 });
            total = total.wrapping_add(here);
            other += 1;
        }
        barrier();
        (before, total)
    }

    fn rank(value: u32, _bits: u32, lane: u32, scratch: &mut Scratch) -> Rank {
        scratch[lane as usize] = value;
        barrier();
        let (mut before, mut after) = (0, 0);
        let mut other = 0;
        while other < COUNT {
            let same = (scratch[other as usize] == value) as u32;
            before += same & (other < lane) as u32;
            after += same & (other > lane) as u32;
            other += 1;
        }
        barrier();
        Rank { before, last: after == 0 }
    }

    fn tally<const N: usize>(
        table: &mut [u32; N],
        index: u32,
        step: u32,
        counted: bool,
        _lane: u32,
        _scratch: &mut Scratch,
    ) {
        if counted {
            add(table, index, step);
        }
    }
}

/// The invocations of a full subgroup of `COUNT`.
pub struct Wave<const COUNT: u32>;

/// Ends a phase of a subgroup: what was written to shared memory can be read, and what was read can be written.
pub fn sync_subgroup() {
    const SCOPE: u32 = Scope::Subgroup as u32;
    const SEMANTICS: u32 = Semantics::ACQUIRE_RELEASE.bits() | Semantics::WORKGROUP_MEMORY.bits();
    control_barrier::<SCOPE, SCOPE, SEMANTICS>();
}

/// Two words that have a bit for each of the first `count` invocations.
fn first(count: u32) -> [u32; 2] {
    let word = |count: u32| if count < 32 { (1 << count) - 1 } else { u32::MAX };
    [word(count), if count > 32 { word(count - 32) } else { 0 }]
}

impl<const COUNT: u32> Lanes for Wave<COUNT> {
    const COUNT: u32 = COUNT;
    const REPEATS: bool = false;

    fn sync() {
        sync_subgroup();
    }

    fn put(_value: u32, _slot: u32, _lane: u32, _scratch: &mut Scratch) {}

    fn get(own: u32, _slot: u32, from: u32, _scratch: &Scratch) -> u32 {
        subgroup_shuffle(own, from)
    }

    fn sum(value: u32, _lane: u32, _scratch: &mut Scratch) -> (u32, u32) {
        let before = subgroup_exclusive_i_add(value);
        (before, subgroup_shuffle(before.wrapping_add(value), COUNT - 1))
    }

    fn rank(value: u32, bits: u32, lane: u32, _scratch: &mut Scratch) -> Rank {
        let [mut low, mut high] = first(COUNT);
        let mut bit = 0;
        while bit < bits {
            let set = (value >> bit) & 1 != 0;
            let others = subgroup_ballot(set);
            low &= if set { others.x } else { !others.x };
            if COUNT > 32 {
                high &= if set { others.y } else { !others.y };
            }
            bit += 1;
        }
        let [low_before, high_before] = first(lane);
        let mut before = (low & low_before).count_ones();
        let mut all = low.count_ones();
        if COUNT > 32 {
            before += (high & high_before).count_ones();
            all += high.count_ones();
        }
        Rank { before, last: before + 1 == all }
    }

    fn tally<const N: usize>(
        table: &mut [u32; N],
        index: u32,
        step: u32,
        counted: bool,
        _lane: u32,
        _scratch: &mut Scratch,
    ) {
        if counted {
            add(table, index, step);
        }
    }
}

/// The invocations of full subgroups of `SUBGROUP`, [`WIDE`] in all. Invocation `lane` is in subgroup
/// `lane / SUBGROUP`.
pub struct Waves<const SUBGROUP: u32>;

impl<const SUBGROUP: u32> Waves<SUBGROUP> {
    /// The number of an invocation.
    pub fn lane(subgroup: u32, invocation: u32) -> u32 {
        subgroup * SUBGROUP + invocation
    }
}

impl<const SUBGROUP: u32> Scan for Waves<SUBGROUP> {
    const COUNT: u32 = WIDE;

    fn scan(value: u32, lane: u32, scratch: &mut Scratch) -> (u32, u32) {
        let own = lane & (SUBGROUP - 1);
        let mut sum = value;
        let mut reach = 1;
        while reach < SUBGROUP {
            sum = widen::<SUBGROUP>(sum, own, reach);
            reach *= 2;
        }
        if own == SUBGROUP - 1 {
            scratch[(lane / SUBGROUP) as usize] = sum;
        }
        barrier();
        let (mut before, mut total) = (sum.wrapping_sub(value), 0);
        let mut other = 0;
        while other < WIDE / SUBGROUP {
            let here = scratch[other as usize];
            before += if other < lane / SUBGROUP { here } else { 0 };
            total = saturating(total, here);
            other += 1;
        }
        barrier();
        (before, total)
    }
}

/// Eight invocations that are one subgroup and run in lockstep. Their stores happen in their order, so the last one's
/// remains without a choice. A choice would cost one branch per lane, which no CPU can predict.
pub struct Lockstep;

/// 1 if the other invocation is before this one and holds the same value.
fn ahead(value: u32, lane: u32, other: u32, its: u32) -> u32 {
    ((its == value) & (other < lane)) as u32
}

/// The value of invocation `ID`. Llvmpipe's own broadcast takes longer than a shuffle.
fn broadcast<const ID: u32>(value: u32) -> u32 {
    subgroup_shuffle(value, ID)
}

/// Widens a sum over the `reach` invocations up to this one: adds the sum over the `reach` invocations before them.
fn widen<const SUBGROUP: u32>(sum: u32, lane: u32, reach: u32) -> u32 {
    let other = subgroup_shuffle(sum, (lane.wrapping_sub(reach)) & (SUBGROUP - 1));
    saturating(sum, if lane >= reach { other } else { 0 })
}

/// As [`widen`], of eight, with a sum that wraps.
fn widen_wrapping(sum: u32, lane: u32, reach: u32) -> u32 {
    let other = subgroup_shuffle(sum, lane.wrapping_sub(reach) & (EIGHT - 1));
    sum.wrapping_add(if lane >= reach { other } else { 0 })
}

impl Scan for Lockstep {
    const COUNT: u32 = EIGHT;

    fn scan(value: u32, lane: u32, _scratch: &mut Scratch) -> (u32, u32) {
        let sum = widen::<EIGHT>(widen::<EIGHT>(widen::<EIGHT>(value, lane, 1), lane, 2), lane, 4);
        (sum.wrapping_sub(value), broadcast::<7>(sum))
    }
}

impl Lanes for Lockstep {
    const COUNT: u32 = EIGHT;
    // Only llvmpipe runs this form. It neither fuses operations nor replaces them.
    const REPEATS: bool = true;

    fn sync() {}

    fn put(_value: u32, _slot: u32, _lane: u32, _scratch: &mut Scratch) {}

    fn get(own: u32, _slot: u32, from: u32, _scratch: &Scratch) -> u32 {
        subgroup_shuffle(own, from)
    }

    fn sum(value: u32, lane: u32, _scratch: &mut Scratch) -> (u32, u32) {
        let sum = widen_wrapping(value, lane, 1);
        let sum = widen_wrapping(sum, lane, 2);
        let sum = widen_wrapping(sum, lane, 4);
        (sum.wrapping_sub(value), broadcast::<7>(sum))
    }

    fn rank(value: u32, _bits: u32, lane: u32, _scratch: &mut Scratch) -> Rank {
        let mut before = ahead(value, lane, 0, broadcast::<0>(value));
        before += ahead(value, lane, 1, broadcast::<1>(value));
        before += ahead(value, lane, 2, broadcast::<2>(value));
        before += ahead(value, lane, 3, broadcast::<3>(value));
        before += ahead(value, lane, 4, broadcast::<4>(value));
        before += ahead(value, lane, 5, broadcast::<5>(value));
        before += ahead(value, lane, 6, broadcast::<6>(value));
        Rank { before, last: true }
    }

    // An atomic locks the bus for each invocation, which costs more than ranking all of them.
    fn tally<const N: usize>(
        table: &mut [u32; N],
        index: u32,
        step: u32,
        counted: bool,
        lane: u32,
        scratch: &mut Scratch,
    ) {
        let rank = Self::rank(if counted { index } else { u32::MAX }, 32, lane, scratch);
        if counted {
            let counter = at_mut(table, index);
            *counter = counter.wrapping_add((rank.before + 1).wrapping_mul(step));
        }
    }
}
