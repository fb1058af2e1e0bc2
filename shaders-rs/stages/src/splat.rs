//! Stage `splat`: front-to-back blending (Kerbl et al. 2023, eq. 3). One workgroup draws one tile.
//! One invocation draws a column of pixels, so that a splat's record is loaded once for all of
//! them.

use crate::list::{Column, LANES, List, Splat, largest, tell_cut};
use crate::portable;
use crate::shared::{self, Counters, LOG_ALPHA_MIN, Params, TILE, TRANSMITTANCE_STOP, max};
use spirv_std::arch::IndexUnchecked;
use spirv_std::glam::{UVec2, UVec3, Vec4};
use spirv_std::spirv;

/// `f` of each of four.
pub fn each(v: Vec4, f: impl Fn(f32) -> f32) -> Vec4 {
    Vec4::new(f(v.x), f(v.y), f(v.z), f(v.w))
}

/// `f` of each pair of two fours.
pub fn both(a: Vec4, b: Vec4, f: impl Fn(f32, f32) -> f32) -> Vec4 {
    Vec4::new(f(a.x, b.x), f(a.y, b.y), f(a.z, b.z), f(a.w, b.w))
}

/// The clamp of alpha. If all splats of a prior are less opaque, its pipelines have no clamp.
#[derive(Clone, Copy)]
pub struct Clamp {
    alpha: f32,
    there: bool,
}

impl Clamp {
    /// From a specialisation constant: 0 for no clamp.
    pub fn new(params: &Params, there: u32) -> Clamp {
        Clamp { alpha: params.alpha_max, there: there != 0 }
    }

    /// Whether it holds this alpha.
    pub fn holds(self, full: f32) -> bool {
        self.there & (full > self.alpha)
    }

    /// The alpha after it.
    pub fn of(self, full: f32) -> f32 {
        if self.holds(full) { self.alpha } else { full }
    }
}

/// A splat's alphas at four pixels.
pub struct Hits {
    /// Before the clamp.
    full: Vec4,
    /// 0 below the cut.
    pub alphas: Vec4,
}

impl Hits {
    /// From log₂ of the alphas before the clamp. `exp2` is [`portable::exp2`], or the device's own in stages that need
    /// not be portable.
    pub fn new(exponents: Vec4, clamp: Clamp, exp2: impl Fn(f32) -> f32) -> Hits {
        let full = each(exponents, exp2);
        let held = each(full, |full| clamp.of(full));
        let alphas =
            both(exponents, held, |exponent, alpha| {
                if exponent >= LOG_ALPHA_MIN { alpha } else { 0.0 }
            });
        Hits { full, alphas }
    }

    /// `values`, but 0 for pixels whose alpha is clamped.
    pub fn where_free(&self, values: Vec4, clamp: Clamp) -> Vec4 {
        both(self.full, values, |full, value| if clamp.holds(full) { 0.0 } else { value })
    }
}

/// Blends a splat into four pixels: returns the weights that the splat gets, and the transmittances
/// behind it. A transmittance becomes negative if the splat finishes the pixel.
pub fn dim(transmittances: Vec4, alphas: Vec4) -> (Vec4, Vec4) {
    let weights = alphas * transmittances;
    let next = transmittances - weights;
    (
        both(weights, next, |w, next| if next > TRANSMITTANCE_STOP { w } else { 0.0 }),
        both(
            transmittances,
            next,
            |t, next| if next > TRANSMITTANCE_STOP { next } else { -t.abs() },
        ),
    )
}

/// First pixel of an invocation's column, of four.
pub fn first_pixel(group: UVec3, lane: u32) -> [u32; 2] {
    [group.x * TILE + lane % TILE, group.y * TILE + lane / TILE * shared::ROWS]
}

/// Middle of the column: its rows lie at −1.5 to 1.5.
pub fn middle([x, y]: [u32; 2]) -> [f32; 2] {
    [x as f32 + 0.5, (y + 2) as f32]
}

/// What there is to blend, by specialisation constants.
#[derive(Clone, Copy)]
struct Blending {
    clamp: Clamp,
    /// Whether depth is wanted beside the colours.
    depth: bool,
}

/// Four pixels, one below the other. Operations take four pixels at once, so that neighbouring
/// instructions do not wait for each other.
#[derive(Clone, Copy)]
struct Four {
    rgb: [Vec4; 3],
    depth: Vec4,
    /// Negative once a pixel is finished.
    transmittance: Vec4,
}

impl Four {
    const EMPTY: Four = Four { rgb: [Vec4::ZERO; 3], depth: Vec4::ZERO, transmittance: Vec4::ONE };

    /// Blends a splat that is seen from `y` above the first pixel.
    fn blend(self, s: &Splat, column: &Column, y: f32, how: Blending) -> Four {
        let hits = Hits::new(column.exponents(y), how.clamp, portable::exp2);
        let (weights, transmittance) = dim(self.transmittance, hits.alphas);
        Four {
            rgb: [
                self.rgb[0] + weights * s.rgb[0],
                self.rgb[1] + weights * s.rgb[1],
                self.rgb[2] + weights * s.rgb[2],
            ],
            depth: if how.depth { self.depth + weights * s.depth } else { self.depth },
            transmittance,
        }
    }

    /// Negative if all pixels are finished.
    fn transmittance(&self) -> f32 {
        let t = self.transmittance;
        max(max(t.x, t.y), max(t.z, t.w))
    }

    fn store(&self, params: &Params, out: &mut [f32], x: u32, y: u32) {
        let ([r, g, b], d, t) = (self.rgb, self.depth, self.transmittance);
        store(params, out, x, y, [r.x, g.x, b.x, d.x, t.x]);
        store(params, out, x, y + 1, [r.y, g.y, b.y, d.y, t.y]);
        store(params, out, x, y + 2, [r.z, g.z, b.z, d.z, t.z]);
        store(params, out, x, y + 3, [r.w, g.w, b.w, d.w, t.w]);
    }
}

fn store(params: &Params, out: &mut [f32], x: u32, y: u32, p: [f32; 5]) {
    if (x < params.width) & (y < params.height) {
        let at = ((y * params.width + x) * shared::PIXEL) as usize;
        let [r, g, b, depth, t] = p;
        let t = t.abs();
        out[at] = r + t * params.background[0];
        out[at + 1] = g + t * params.background[1];
        out[at + 2] = b + t * params.background[2];
        out[at + 3] = depth;
        out[at + 4] = t;
    }
}

/// The range of a workgroup's tile.
pub fn range(params: &Params, ranges: &[UVec2], group: UVec3) -> UVec2 {
    // SAFETY: a workgroup per tile, a range per tile.
    unsafe { *ranges.index_unchecked((group.y * params.tiles_x + group.x) as usize) }
}

/// One workgroup per tile.
#[spirv(compute(threads(16)))]
pub fn splat(
    #[spirv(workgroup_id)] group: UVec3,
    #[spirv(local_invocation_index)] lane: u32,
    #[spirv(spec_constant(id = 1, default = 1))] clamp: u32,
    #[spirv(spec_constant(id = 2, default = 1))] depth: u32,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] ranges: &[UVec2],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] pair_splats: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] records: &[Vec4],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] out: &mut [f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] counters: &mut Counters,
) {
    let range = range(params, ranges, group);
    let list = List { records, pair_splats, end: range.y, centre: middle_of_tile(group) };
    let how = Blending { clamp: Clamp::new(params, clamp), depth: depth != 0 };
    let x = (lane % TILE) as f32 - 3.5;
    let y = (lane / TILE * shared::ROWS) as f32 - 3.5;
    let mut pixels = Four::EMPTY;
    let mut at = range.x;
    while at < range.y {
        let s = list.load(at);
        pixels = pixels.blend(&s, &s.along(x), y, how);
        at += 1;
        if pixels.transmittance() < 0.0 {
            break;
        }
    }
    if (at < range.y) & !(pixels.transmittance() < 0.0) {
        tell_cut(counters);
    }
    let [x, y] = first_pixel(group, lane);
    pixels.store(params, out, x, y);
}

/// The whole column of a tile.
type Eight = (Four, Four);

fn blend_eight((upper, lower): Eight, s: &Splat, x: f32, how: Blending) -> Eight {
    let column = s.along(x);
    (upper.blend(s, &column, -3.5, how), lower.blend(s, &column, 0.5, how))
}

/// Middle of a workgroup's tile: its columns and rows lie at −3.5 to 3.5.
pub fn middle_of_tile(group: UVec3) -> [f32; 2] {
    let half = (TILE / 2) as f32;
    [(group.x * TILE) as f32 + half, (group.y * TILE) as f32 + half]
}

/// The form for subgroups of eight. One workgroup per tile.
#[spirv(compute(threads(8)))]
pub fn splat_lockstep(
    #[spirv(workgroup_id)] group: UVec3,
    #[spirv(subgroup_local_invocation_id)] lane: u32,
    #[spirv(spec_constant(id = 1, default = 1))] clamp: u32,
    #[spirv(spec_constant(id = 2, default = 1))] depth: u32,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] ranges: &[UVec2],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] pair_splats: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] records: &[Vec4],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] out: &mut [f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] counters: &mut Counters,
) {
    let range = range(params, ranges, group);
    let list = List { records, pair_splats, end: range.y, centre: middle_of_tile(group) };
    let how = Blending { clamp: Clamp::new(params, clamp), depth: depth != 0 };
    let x = lane as f32 - 3.5;
    let mut pixels = (Four::EMPTY, Four::EMPTY);
    let mut at = range.x;
    while at < range.y {
        let own = list.load(at + lane);
        pixels = blend_eight(pixels, &own.of(0), x, how);
        pixels = blend_eight(pixels, &own.of(1), x, how);
        pixels = blend_eight(pixels, &own.of(2), x, how);
        pixels = blend_eight(pixels, &own.of(3), x, how);
        pixels = blend_eight(pixels, &own.of(4), x, how);
        pixels = blend_eight(pixels, &own.of(5), x, how);
        pixels = blend_eight(pixels, &own.of(6), x, how);
        pixels = blend_eight(pixels, &own.of(7), x, how);
        at += LANES;
        let left = max(pixels.0.transmittance(), pixels.1.transmittance());
        if largest(left, lane) < 0.0 {
            break;
        }
    }
    let left = max(pixels.0.transmittance(), pixels.1.transmittance());
    if (at < range.y) & !(largest(left, lane) < 0.0) {
        tell_cut(counters);
    }
    let (x, y) = (group.x * TILE + lane, group.y * TILE);
    pixels.0.store(params, out, x, y);
    pixels.1.store(params, out, x, y + 4);
}
