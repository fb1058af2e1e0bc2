//! The splats of a tile, front to back, as the blending stages read them: a record at a time, or
//! eight at a time for subgroups of eight.
//!
//! Milliseconds of stage `splat` on the reef at 320×180, llvmpipe, one core: 45.6 as it was, every
//! invocation loading every record; 16.8 with a subgroup to a tile, where each invocation loads one
//! record of eight and hands it round by shuffles (llvmpipe walks through the invocations for a load,
//! but shuffles in one instruction); 10.3 with all eight unrolled (each turn of a loop masks all that
//! it carries). A GPU that loads one address for a whole subgroup at once needs none of this.

use crate::shared::{self, RECORD};
use core::arch::asm;
use spirv_std::arch::{IndexUnchecked, subgroup_shuffle};
use spirv_std::glam::Vec4;
use spirv_std::num_traits::Float;

/// Invocations of a workgroup that hands records round; splats that it takes at a time.
pub const LANES: u32 = 8;
/// `√(½ log₂ e)`: the conic's factor times this gives alpha's exponent, to base 2, as squares.
const TO_BASE_2: f32 = 0.849_321_8;
/// What a product of two scaled values must be multiplied by.
pub const PRODUCT: f32 = 1.0 / (TO_BASE_2 * TO_BASE_2);

/// A splat as seen from one pixel.
#[derive(Clone, Copy)]
pub struct Splat {
    /// The conic's factor times the vector from the pixel to the mean, scaled: alpha is
    /// `2^(exponent − u² − w²)`.
    pub u: f32,
    pub w: f32,
    /// The conic's factor, scaled: a pixel to the right takes `l11` from `u`; one down takes `l21`
    /// from `u` and `l22` from `w`.
    pub l11: f32,
    pub l21: f32,
    pub l22: f32,
    /// log₂ of the opacity.
    pub exponent: f32,
    pub rgb: [f32; 3],
    pub depth: f32,
}

/// Part of a tile's list.
#[derive(Clone, Copy)]
pub struct List<'a> {
    pub records: &'a [Vec4],
    pub pair_splats: &'a [u32],
    /// One past the last pair.
    pub end: u32,
    /// Centre of the pixel from which splats are seen.
    pub centre: [f32; 2],
}

impl List<'_> {
    /// The splat of pair `at`; one that shows nowhere from the end on. There must be a pair.
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
        let (l11, l21, l22) = (a.z * TO_BASE_2, a.w * TO_BASE_2, b.x * TO_BASE_2);
        Splat {
            u: l11 * dx + l21 * dy,
            w: l22 * dy,
            l11,
            l21,
            l22,
            exponent: if inside { b.y.log2() } else { -1000.0 },
            rgb: [c.x, c.y, c.z],
            depth: c.w,
        }
    }
}

impl Splat {
    /// The splat that invocation `j` of the subgroup holds, seen from `column` pixels to the right.
    pub fn of(&self, j: u32, column: f32) -> Splat {
        let l11 = subgroup_shuffle(self.l11, j);
        Splat {
            u: subgroup_shuffle(self.u, j) - l11 * column,
            w: subgroup_shuffle(self.w, j),
            l11,
            l21: subgroup_shuffle(self.l21, j),
            l22: subgroup_shuffle(self.l22, j),
            exponent: subgroup_shuffle(self.exponent, j),
            rgb: [
                subgroup_shuffle(self.rgb[0], j),
                subgroup_shuffle(self.rgb[1], j),
                subgroup_shuffle(self.rgb[2], j),
            ],
            depth: subgroup_shuffle(self.depth, j),
        }
    }
}

/// The largest value that an invocation of eight has.
pub fn largest(value: f32, lane: u32) -> f32 {
    let of_two = shared::max(value, subgroup_shuffle(value, lane ^ 1));
    let of_four = shared::max(of_two, subgroup_shuffle(of_two, lane ^ 2));
    shared::max(of_four, subgroup_shuffle(of_four, lane ^ 4))
}

/// The sum over eight invocations.
pub fn total(value: f32, lane: u32) -> f32 {
    let of_two = value + subgroup_shuffle(value, lane ^ 1);
    let of_four = of_two + subgroup_shuffle(of_two, lane ^ 2);
    of_four + subgroup_shuffle(of_four, lane ^ 4)
}

/// Loads a vector at once; the compiler loads its components one by one, and llvmpipe walks through
/// the invocations for each (14.2 ms against 12.0, same scene).
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
