//! The splats of a tile, front to back, as the blending stages read them.
//!
//! Plain: each invocation loads one splat after another. Wave: the invocations of a subgroup load one splat each, and
//! read each other's from shared memory. Lockstep: as wave, but by shuffles, which cost a CPU driver less than shared
//! memory. What each of these forms takes: docs/decisions.md, 6.

use crate::memory::{at, at_mut};
use crate::portable::{self, POWER_SCALE, POWER_SHIFT};
use crate::rows::Rows;
use crate::shared::{
    self, Counters, FACTOR, LOG_ALPHA_MIN, NOWHERE, POWER_FACTOR, POWER_MIN, RECORD,
};
use core::arch::asm;
use spirv_std::arch::{IndexUnchecked, atomic_u_max, subgroup_shuffle};
use spirv_std::glam::Vec4;
use spirv_std::memory::{Scope, Semantics};
use spirv_std::num_traits::Float;

/// Invocations of a lockstep subgroup; also the splats that it takes at a time.
pub const LANES: u32 = 8;
/// What a [pull](Column::pull) must be multiplied by.
pub const PRODUCT: f32 = 0.5 / (FACTOR * FACTOR);

/// How alpha is computed. Its argument is a linear function of log₂ alpha.
pub trait Power {
    /// What the conic's factor is multiplied by, so that the argument is a difference of squares.
    const FACTOR: f32;
    /// The argument of the least alpha that counts.
    const MIN: f32;

    /// The argument from log₂ alpha.
    fn argument(log_alpha: f32) -> f32;

    /// Alpha.
    fn alpha(argument: f32) -> f32;
}

/// The same on every device.
pub struct Portable;

impl Power for Portable {
    const FACTOR: f32 = POWER_FACTOR;
    const MIN: f32 = POWER_MIN;

    fn argument(log_alpha: f32) -> f32 {
        POWER_SHIFT + POWER_SCALE * log_alpha
    }

    fn alpha(argument: f32) -> f32 {
        portable::power(argument)
    }
}

/// The device's own.
pub struct Native;

impl Power for Native {
    const FACTOR: f32 = FACTOR;
    const MIN: f32 = LOG_ALPHA_MIN;

    fn argument(log_alpha: f32) -> f32 {
        log_alpha
    }

    fn alpha(argument: f32) -> f32 {
        argument.exp2()
    }
}

/// A splat as seen along the columns of a tile, from points at an offset `(x, y)` from the centre. The factor's rows
/// are `u = u₀ − l₁₁ x − l₂₁ y` and `w = w₀ − l₂₂ y`. Alpha's argument is `a − u² − w²`, expanded in `y`.
#[derive(Clone, Copy)]
pub struct Splat {
    /// `u₀`.
    pub u: f32,
    pub l11: f32,
    /// `2 l₂₁`.
    pub tilt: f32,
    /// `2 l₁₁`.
    pub wide: f32,
    /// `2 l₁₁ l₂₁`.
    pub turn: f32,
    /// The part of the argument that is the same for all columns, `a − w₀²`.
    pub level: f32,
    /// `2 l₂₂ w₀`.
    pub down: f32,
    /// `l₂₁² + l₂₂²`.
    pub curve: f32,
    pub depth: f32,
    pub rgb: [f32; 3],
}

/// `Vec4`s of a splat in shared memory.
pub const SPLAT: u32 = 3;

/// A splat along one column, a quadratic in `y`.
#[derive(Clone, Copy)]
pub struct Column {
    level: f32,
    curve: f32,
    /// `2 v` at the centre, for `v = Q d`, and its slope, `2 v − y turn`.
    v: [f32; 2],
    turn: f32,
}

/// Part of a tile's list.
#[derive(Clone, Copy)]
pub struct List<'a> {
    pub records: &'a [Vec4],
    pub pair_splats: &'a [u32],
    /// One past the last pair.
    pub end: u32,
    /// The point from which splats are seen, pixels.
    pub centre: [f32; 2],
}

impl List<'_> {
    /// The splat of pair `at`; from the end on, a splat that shows nowhere. There must be at least one pair.
    pub fn load<P: Power>(&self, at: u32) -> Splat {
        let inside = at < self.end;
        let place = if inside { at } else { self.end - 1 };
        // SAFETY: stage `ranges` keeps ends within the pairs, stage `bin_emit` makes pairs of splats
        // that have a record.
        let (a, b, c) = unsafe {
            let i = (*self.pair_splats.index_unchecked(place as usize) * RECORD) as usize;
            (whole(self.records, i), whole(self.records, i + 1), whole(self.records, i + 2))
        };
        let (dx, dy) = (a.x - self.centre[0], a.y - self.centre[1]);
        let (l11, l21, l22) = (a.z * P::FACTOR, a.w * P::FACTOR, b.x * P::FACTOR);
        let w = l22 * dy;
        let argument = P::argument(if inside { b.y } else { NOWHERE });
        Splat {
            u: l11 * dx + l21 * dy,
            l11,
            tilt: l21 + l21,
            wide: l11 + l11,
            turn: (l11 + l11) * l21,
            level: argument - w * w,
            down: (l22 + l22) * w,
            curve: l21 * l21 + l22 * l22,
            depth: c.w,
            rgb: [c.x, c.y, c.z],
        }
    }
}

impl Splat {
    /// The splat that invocation `j` of the subgroup holds.
    pub fn of(&self, j: u32) -> Splat {
        Splat {
            u: subgroup_shuffle(self.u, j),
            l11: subgroup_shuffle(self.l11, j),
            tilt: subgroup_shuffle(self.tilt, j),
            wide: subgroup_shuffle(self.wide, j),
            turn: subgroup_shuffle(self.turn, j),
            level: subgroup_shuffle(self.level, j),
            down: subgroup_shuffle(self.down, j),
            curve: subgroup_shuffle(self.curve, j),
            depth: subgroup_shuffle(self.depth, j),
            rgb: rgb_of(self.rgb, j),
        }
    }

    /// Publishes it in place `slot` of shared memory.
    pub fn put<const N: usize>(&self, shared: &mut [Vec4; N], slot: u32) {
        let [r, g, b] = self.rgb;
        *at_mut(shared, slot * SPLAT) = Vec4::new(self.u, self.l11, self.tilt, self.level);
        *at_mut(shared, slot * SPLAT + 1) = Vec4::new(self.down, self.curve, self.wide, self.turn);
        *at_mut(shared, slot * SPLAT + 2) = Vec4::new(r, g, b, self.depth);
    }

    /// The splat in place `slot`.
    pub fn get<const N: usize>(shared: &[Vec4; N], slot: u32) -> Splat {
        let a: Vec4 = at(shared, slot * SPLAT);
        let b: Vec4 = at(shared, slot * SPLAT + 1);
        let c: Vec4 = at(shared, slot * SPLAT + 2);
        Splat {
            u: a.x,
            l11: a.y,
            tilt: a.z,
            level: a.w,
            down: b.x,
            curve: b.y,
            wide: b.z,
            turn: b.w,
            rgb: [c.x, c.y, c.z],
            depth: c.w,
        }
    }

    /// The splat along the column at `x`.
    pub fn along(&self, x: f32) -> Column {
        let u = self.u - self.l11 * x;
        Column {
            level: self.level - u * u,
            curve: self.curve,
            v: [self.wide * u, self.tilt * u + self.down],
            turn: self.turn,
        }
    }
}

/// The colour that invocation `j` of the subgroup holds.
pub fn rgb_of([r, g, b]: [f32; 3], j: u32) -> [f32; 3] {
    [subgroup_shuffle(r, j), subgroup_shuffle(g, j), subgroup_shuffle(b, j)]
}

impl Column {
    /// Alpha's argument, not clamped, at rows `y`.
    pub fn arguments<R: Rows>(&self, y: R) -> R {
        R::all(self.level) + y * (R::all(self.v[1]) - y * R::all(self.curve))
    }

    /// `2 v`, for `v = Q d`, alpha's derivative with respect to the mean, at rows `y`. For [`Native`], it
    /// must be multiplied by [`PRODUCT`].
    pub fn pull<R: Rows>(&self, y: R) -> [R; 2] {
        let slope = R::all(self.v[1]) - y * R::all(self.curve);
        [R::all(self.v[0]) - y * R::all(self.turn), slope - y * R::all(self.curve)]
    }
}

/// Tells the host that a list was not written or read to its end: llvmpipe ends an invocation's loops after 65,535
/// rounds. The sign is more pairs than there can be room for.
pub fn tell_cut(counters: &mut Counters) {
    need_pairs(counters, u32::MAX);
}

/// Tells the host of how many pairs there must be room for.
pub fn need_pairs(counters: &mut Counters, pairs: u32) {
    // SAFETY: an atomic on a word of a storage buffer.
    unsafe {
        const SCOPE: u32 = Scope::QueueFamily as u32;
        const RELAXED: u32 = Semantics::NONE.bits();
        atomic_u_max::<u32, SCOPE, RELAXED>(&mut counters.pairs_needed, pairs);
    }
}

/// The largest value that an invocation of eight has.
pub fn largest(value: f32, lane: u32) -> f32 {
    let of_two = shared::max(value, subgroup_shuffle(value, lane ^ 1));
    let of_four = shared::max(of_two, subgroup_shuffle(of_two, lane ^ 2));
    shared::max(of_four, subgroup_shuffle(of_four, lane ^ 4))
}

/// Loads a vector at once. The compiler would load its components one by one, and llvmpipe walks
/// through the invocations for each.
///
/// # Safety
/// `at` must be inside.
unsafe fn whole(vectors: &[Vec4], at: usize) -> Vec4 {
    let mut value = Vec4::ZERO;
    unsafe {
        asm! {
            "%value = OpLoad _ {from}",
            "OpStore {to} %value",
            from = in(reg) vectors.index_unchecked(at),
            to = in(reg) &mut value,
        }
    }
    value
}
