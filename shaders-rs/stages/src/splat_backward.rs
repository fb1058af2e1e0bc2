//! Stage `splat_backward`: what each splat's colour, place and shape in the picture do to the loss, summed over each
//! tile.
//!
//! It blends as stage `splat` does, front to back, with the same power, but products and sums may be fused. With `g`
//! the loss's gradient by a pixel, `q = c · g` and `total = C · g` (`C` the render's colour), the gradient by alpha is
//! `T q − (total − Σ w q) / (1 − α)`: the sum runs over all splats up to this one, so what lies behind need not be
//! known (Kerbl et al. 2023 go back to front). A tile that shows no splat that is trained is left out.

use crate::blend::{Clamp, Hits, middle, range};
use crate::list::{LANES, List, Portable, Splat, largest};
use crate::memory::{PairsMut, at, at_mut};
use crate::portable::power_slope;
use crate::rows::Rows;
use crate::shared::{Outline, Params, ROWS, SPLAT_THREADS, TILE, TRANSMITTANCE_STOP, max};
use crate::train_slots;
use crate::training::{GRADIENT_PIXEL, NO_PAIR, PAIR_FLOATS, PAIR_SUMS, slot_box};
use spirv_std::arch::{subgroup_shuffle, workgroup_memory_barrier_with_group_sync as barrier};
use spirv_std::glam::{UVec2, UVec3, Vec4};
use spirv_std::spirv;

/// Four pixels, one below the other.
#[derive(Clone, Copy)]
struct Four {
    /// The loss's gradient.
    g: [Vec4; 3],
    /// `total` less what splats up to here show.
    behind: Vec4,
    transmittance: Vec4,
}

/// Sums over some pixels of a column: Σ w g, Σ h, Σ h y, Σ h y².
#[derive(Clone, Copy)]
struct Sums {
    colour: [f32; 3],
    h: f32,
    hy: f32,
    hyy: f32,
}

/// The loss's gradient at a pixel; beyond the picture none.
fn gradient_at(params: &Params, gradient: &[f32], x: u32, y: u32) -> [f32; 4] {
    let inside = (x < params.width) & (y < params.height);
    let first = if inside { (y * params.width + x) * GRADIENT_PIXEL } else { 0 };
    let scale = if inside { 1.0 } else { 0.0 };
    [
        scale * at::<f32, _>(gradient, first),
        scale * at::<f32, _>(gradient, first + 1),
        scale * at::<f32, _>(gradient, first + 2),
        scale * at::<f32, _>(gradient, first + 3),
    ]
}

impl Four {
    fn load(params: &Params, gradient: &[f32], x: u32, y: u32) -> Four {
        let a = gradient_at(params, gradient, x, y);
        let b = gradient_at(params, gradient, x, y + 1);
        let c = gradient_at(params, gradient, x, y + 2);
        let d = gradient_at(params, gradient, x, y + 3);
        Four {
            g: [
                Vec4::new(a[0], b[0], c[0], d[0]),
                Vec4::new(a[1], b[1], c[1], d[1]),
                Vec4::new(a[2], b[2], c[2], d[2]),
            ],
            behind: Vec4::new(a[3], b[3], c[3], d[3]),
            transmittance: Vec4::ONE,
        }
    }

    /// Blends a splat that is seen from `y` above the first pixel.
    fn blend(self, s: &Splat, x: f32, y: f32, clamp: Clamp) -> (Four, Sums) {
        let rows = Vec4::down(y);
        let arguments: Vec4 = s.along(x).arguments(rows);
        let hits = Hits::new::<Portable>(arguments, self.transmittance, clamp);
        let weights = hits.alphas * self.transmittance;
        let transmittance = self.transmittance - weights;
        let q = self.g[0] * s.rgb[0] + self.g[1] * s.rgb[1] + self.g[2] * s.rgb[2];
        let shown = weights * q;
        let rest = self.behind - shown;
        // By log alpha: α (T q − rest / (1 − α)).
        let covered = hits.alphas.both(weights, |a, w| if w > 0.0 { a / (1.0 - a) } else { 0.0 });
        let h = hits.where_free(shown - rest * covered, clamp) * arguments.each(power_slope);
        let hy = h * rows;
        let sums = Sums {
            colour: [
                (weights * self.g[0]).sum(),
                (weights * self.g[1]).sum(),
                (weights * self.g[2]).sum(),
            ],
            h: (h).sum(),
            hy: (hy).sum(),
            hyy: (hy * rows).sum(),
        };
        (Four { behind: rest, transmittance, ..self }, sums)
    }

    /// The largest transmittance.
    fn left(&self) -> f32 {
        self.transmittance.largest()
    }
}

impl Sums {
    fn plus(self, o: Sums) -> Sums {
        Sums {
            colour: [
                self.colour[0] + o.colour[0],
                self.colour[1] + o.colour[1],
                self.colour[2] + o.colour[2],
            ],
            h: self.h + o.h,
            hy: self.hy + o.hy,
            hyy: self.hyy + o.hyy,
        }
    }

    /// All sums of a pair, of the column at `x`.
    fn of_column(self, x: f32) -> [f32; PAIR_SUMS as usize] {
        let hx = self.h * x;
        let [r, g, b] = self.colour;
        [r, g, b, self.h, hx, self.hy, hx * x, self.hy * x, self.hyy]
    }
}

/// Writes the sums of pair `at`, and notes the pair in its splat's slot for the tile.
fn store<P: PairsMut + ?Sized>(
    params: &Params,
    records: &[Vec4],
    starts: &[u32],
    slots: &mut [u32],
    pairs: &mut P,
    pair: u32,
    splat: u32,
    group: UVec3,
    sums: [f32; PAIR_SUMS as usize],
) {
    let first = pair * PAIR_FLOATS;
    pairs.put(first, [sums[0], sums[1]]);
    pairs.put(first + 1, [sums[2], sums[3]]);
    pairs.put(first + 2, [sums[4], sums[5]]);
    pairs.put(first + 3, [sums[6], sums[7]]);
    pairs.put(first + 4, [sums[8], 0.0]);
    let start: u32 = at(starts, splat);
    let outline = Outline::new(params, &train_slots::load(records, splat));
    let [x0, y0, x1, y1] = slot_box(params, &outline);
    let inside = (group.x >= x0) & (group.x < x1) & (group.y >= y0) & (group.y < y1);
    if inside & (start != NO_PAIR) {
        *at_mut(slots, start + (group.y - y0) * (x1 - x0) + group.x - x0) = pair;
    }
}

/// Adds what all eight invocations have.
fn total(value: f32, lane: u32) -> f32 {
    let of_two = value + subgroup_shuffle(value, lane ^ 1);
    let of_four = of_two + subgroup_shuffle(of_two, lane ^ 2);
    of_four + subgroup_shuffle(of_four, lane ^ 4)
}

/// Whether a tile shows a splat that is trained. Each of `lanes` invocations that call it sees a part of the list.
fn shows_trained(starts: &[u32], pair_splats: &[u32], range: UVec2, lane: u32, lanes: u32) -> bool {
    let mut pair = range.x + lane;
    while pair < range.y {
        if at::<u32, _>(starts, at::<u32, _>(pair_splats, pair)) != NO_PAIR {
            return true;
        }
        pair += lanes;
    }
    false
}

/// The whole column of a tile.
type Eight = (Four, Four);

/// Blends splat `j` of those that the invocations hold; invocation `j` keeps the tile's sums.
fn blend_eight(
    (upper, lower): Eight,
    own: &Splat,
    j: u32,
    lane: u32,
    clamp: Clamp,
    kept: &mut [f32; PAIR_SUMS as usize],
) -> Eight {
    let s = own.of(j);
    let x = lane as f32 - 3.5;
    let (upper, above) = upper.blend(&s, x, -3.5, clamp);
    let (lower, below) = lower.blend(&s, x, 0.5, clamp);
    let sums = above.plus(below).of_column(x);
    let keeps = lane == j;
    let keep = |before: f32, sum: f32| {
        let all = total(sum, lane);
        if keeps { all } else { before }
    };
    *kept = [
        keep(kept[0], sums[0]),
        keep(kept[1], sums[1]),
        keep(kept[2], sums[2]),
        keep(kept[3], sums[3]),
        keep(kept[4], sums[4]),
        keep(kept[5], sums[5]),
        keep(kept[6], sums[6]),
        keep(kept[7], sums[7]),
        keep(kept[8], sums[8]),
    ];
    (upper, lower)
}

/// One workgroup per tile, for subgroups of eight.
#[spirv(compute(threads(8)))]
pub fn splat_backward_lockstep(
    #[spirv(workgroup_id)] group: UVec3,
    #[spirv(subgroup_local_invocation_id)] lane: u32,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] ranges: &[UVec2],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] pair_splats: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] records: &[Vec4],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] gradient: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] starts: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 6)] slots: &mut [u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 7)] pairs: &mut [u64],
) {
    let range = range(params, ranges, [group.x, group.y]);
    let trained = shows_trained(starts, pair_splats, range, lane, LANES);
    if largest(if trained { 1.0 } else { 0.0 }, lane) == 0.0 {
        return;
    }
    let list = List { records, pair_splats, end: range.y, centre: middle([group.x, group.y]) };
    let clamp = Clamp::new(params, 1);
    let (x, y) = (group.x * TILE + lane, group.y * TILE);
    let mut pixels =
        (Four::load(params, gradient, x, y), Four::load(params, gradient, x, y + ROWS));
    let mut first = range.x;
    while first < range.y {
        let own = list.load::<Portable>(first + lane);
        let mut kept = [0.0; PAIR_SUMS as usize];
        pixels = blend_eight(pixels, &own, 0, lane, clamp, &mut kept);
        pixels = blend_eight(pixels, &own, 1, lane, clamp, &mut kept);
        pixels = blend_eight(pixels, &own, 2, lane, clamp, &mut kept);
        pixels = blend_eight(pixels, &own, 3, lane, clamp, &mut kept);
        pixels = blend_eight(pixels, &own, 4, lane, clamp, &mut kept);
        pixels = blend_eight(pixels, &own, 5, lane, clamp, &mut kept);
        pixels = blend_eight(pixels, &own, 6, lane, clamp, &mut kept);
        pixels = blend_eight(pixels, &own, 7, lane, clamp, &mut kept);
        let pair = first + lane;
        if pair < range.y {
            let splat: u32 = at(pair_splats, pair);
            store(params, records, starts, slots, pairs, pair, splat, group, kept);
        }
        first += LANES;
        let left = max(pixels.0.left(), pixels.1.left());
        if largest(left, lane) <= TRANSMITTANCE_STOP {
            break;
        }
    }
}

/// Words that each invocation of the plain form publishes: the sums, and whether it has pixels left.
const PUBLISHED: u32 = PAIR_SUMS + 1;

/// One workgroup per tile.
#[spirv(compute(threads(16)))]
pub fn splat_backward(
    #[spirv(workgroup_id)] group: UVec3,
    #[spirv(local_invocation_index)] lane: u32,
    #[spirv(workgroup)] scratch: &mut [f32; (PUBLISHED * SPLAT_THREADS) as usize],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] ranges: &[UVec2],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] pair_splats: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] records: &[Vec4],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] gradient: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] starts: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 6)] slots: &mut [u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 7)] pairs: &mut [f32],
) {
    let range = range(params, ranges, [group.x, group.y]);
    if !shows_trained(starts, pair_splats, range, 0, 1) {
        return;
    }
    let list = List { records, pair_splats, end: range.y, centre: middle([group.x, group.y]) };
    let clamp = Clamp::new(params, 1);
    let (column, row) = (lane % TILE, lane / TILE * ROWS);
    let (x, y) = (column as f32 - 3.5, row as f32 - 3.5);
    let mut pixels = Four::load(params, gradient, group.x * TILE + column, group.y * TILE + row);
    let mut pair = range.x;
    while pair < range.y {
        let (next, sums) = pixels.blend(&list.load::<Portable>(pair), x, y, clamp);
        pixels = next;
        let sums = sums.of_column(x);
        let mut k = 0;
        while k < PAIR_SUMS {
            scratch[(k * SPLAT_THREADS + lane) as usize] = sums[k as usize];
            k += 1;
        }
        scratch[(PAIR_SUMS * SPLAT_THREADS + lane) as usize] =
            if pixels.left() > TRANSMITTANCE_STOP { 1.0 } else { 0.0 };
        barrier();
        let mut all = [0.0; PAIR_SUMS as usize];
        let (mut left, mut other) = (0.0, 0);
        while other < SPLAT_THREADS {
            left += scratch[(PAIR_SUMS * SPLAT_THREADS + other) as usize];
            other += 1;
        }
        if lane == 0 {
            let mut k = 0;
            while k < PAIR_SUMS {
                let mut other = 0;
                while other < SPLAT_THREADS {
                    all[k as usize] += scratch[(k * SPLAT_THREADS + other) as usize];
                    other += 1;
                }
                k += 1;
            }
            let splat: u32 = at(pair_splats, pair);
            store(params, records, starts, slots, pairs, pair, splat, group, all);
        }
        barrier();
        pair += 1;
        if left == 0.0 {
            break;
        }
    }
}
