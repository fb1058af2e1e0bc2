//! The splats of a tile, front to back, as the blending stages read them: one record at a time, or
//! eight at a time for subgroups of eight.
//!
//! A GPU loads one address for a whole subgroup at once. On a CPU each invocation would load the same record again, so
//! there invocations hand records to each other. What each of these forms takes: docs/decisions.md, 6.

use crate::shared::{self, Counters, FACTOR, NOWHERE, RECORD};
use core::arch::asm;
use spirv_std::arch::{IndexUnchecked, atomic_u_max, subgroup_shuffle};
use spirv_std::glam::Vec4;
use spirv_std::memory::{Scope, Semantics};

/// Invocations of a workgroup whose invocations hand records to each other; also the splats that it takes at a time.
pub const LANES: u32 = 8;
/// What a product of two scaled values must be multiplied by.
pub const PRODUCT: f32 = 1.0 / (FACTOR * FACTOR);

/// A splat as seen along the columns of a tile, from points at an offset `(x, y)` from the centre.
/// The factor's rows are `u = u₀ − l₁₁ x − l₂₁ y` and `w = w₀ − l₂₂ y`. Alpha's exponent is `log₂ α
/// − u² − w²`, expanded in `y`.
#[derive(Clone, Copy)]
pub struct Splat {
    /// `u₀`.
    pub u: f32,
    pub l11: f32,
    pub l21: f32,
    /// The part of the exponent that is the same for all columns, `log₂ α − w₀²`.
    pub level: f32,
    /// `l₂₂ w₀`.
    pub down: f32,
    /// `l₂₁² + l₂₂²`.
    pub curve: f32,
    pub rgb: [f32; 3],
    pub depth: f32,
}

/// A splat along one column, a quadratic in `y`.
#[derive(Clone, Copy)]
pub struct Column {
    exponent: f32,
    curve: f32,
    /// `v = Q d` at the centre and its slope, `v − y·turn`.
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
    pub fn load(&self, at: u32) -> Splat {
        let inside = at < self.end;
        let place = if inside { at } else { self.end - 1 };
        // SAFETY: stage `ranges` keeps ends within the pairs, stage `bin_emit` makes pairs of splats
        // that have a record.
        let (a, b, c) = unsafe {
            let i = (*self.pair_splats.index_unchecked(place as usize) * RECORD) as usize;
            (whole(self.records, i), whole(self.records, i + 1), whole(self.records, i + 2))
        };
        let (dx, dy) = (a.x - self.centre[0], a.y - self.centre[1]);
        let (l11, l21, l22) = (a.z * FACTOR, a.w * FACTOR, b.x * FACTOR);
        let w = l22 * dy;
        let log = if inside { b.y } else { NOWHERE };
        Splat {
            u: l11 * dx + l21 * dy,
            l11,
            l21,
            level: log - w * w,
            down: l22 * w,
            curve: l21 * l21 + l22 * l22,
            rgb: [c.x, c.y, c.z],
            depth: c.w,
        }
    }
}

impl Splat {
    /// The splat that invocation `j` of the subgroup holds.
    pub fn of(&self, j: u32) -> Splat {
        Splat {
            u: subgroup_shuffle(self.u, j),
            l11: subgroup_shuffle(self.l11, j),
            l21: subgroup_shuffle(self.l21, j),
            level: subgroup_shuffle(self.level, j),
            down: subgroup_shuffle(self.down, j),
            curve: subgroup_shuffle(self.curve, j),
            rgb: [
                subgroup_shuffle(self.rgb[0], j),
                subgroup_shuffle(self.rgb[1], j),
                subgroup_shuffle(self.rgb[2], j),
            ],
            depth: subgroup_shuffle(self.depth, j),
        }
    }

    /// The splat along the column at `x`.
    pub fn along(&self, x: f32) -> Column {
        let u = self.u - self.l11 * x;
        Column {
            exponent: self.level - u * u,
            curve: self.curve,
            v: [self.l11 * u, self.l21 * u + self.down],
            turn: self.l11 * self.l21,
        }
    }
}

impl Column {
    /// log₂ alpha, not clamped, at `y` and the three rows below.
    pub fn exponents(&self, y: f32) -> Vec4 {
        let y = rows(y);
        Vec4::splat(self.exponent) - y * y * self.curve + y * 2.0 * self.v[1]
    }

    /// `v = Q d`, alpha's derivative with respect to the mean, at `y` and the three rows below. It is too small by the
    /// factor [`PRODUCT`].
    pub fn pull(&self, y: f32) -> [Vec4; 2] {
        let y = rows(y);
        [Vec4::splat(self.v[0]) - y * self.turn, Vec4::splat(self.v[1]) - y * self.curve]
    }
}

fn rows(y: f32) -> Vec4 {
    Vec4::new(y, y + 1.0, y + 2.0, y + 3.0)
}

/// Tells the host that a list was not read to its end: llvmpipe ends an invocation's loops after 65,535 rounds. The
/// sign is more pairs than there can be room for.
pub fn tell_cut(counters: &mut Counters) {
    // SAFETY: an atomic on a word of a storage buffer.
    unsafe {
        const SCOPE: u32 = Scope::QueueFamily as u32;
        const RELAXED: u32 = Semantics::NONE.bits();
        atomic_u_max::<u32, SCOPE, RELAXED>(&mut counters.pairs_needed, u32::MAX);
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
