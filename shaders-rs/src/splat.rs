//! Stage `splat`: front-to-back blending (Kerbl et al. 2023, eq. 3). A workgroup draws a tile; an
//! invocation draws a column of pixels, so that a splat's record is loaded once for all of them.

use crate::list::{LANES, List, Splat, largest};
use crate::shared::{self, ALPHA_MIN, Params, TILE, TRANSMITTANCE_STOP, max};
use spirv_std::arch::IndexUnchecked;
use spirv_std::glam::{UVec2, UVec3, Vec4};
use spirv_std::num_traits::Float;
use spirv_std::spirv;

/// A splat at one pixel.
#[derive(Clone, Copy)]
pub struct Hit {
    /// 0 below the cut.
    pub alpha: f32,
    /// Whether the clamp holds alpha.
    pub clamped: bool,
    /// See [`Splat`].
    pub u: f32,
    pub w: f32,
}

impl Hit {
    /// `row` pixels below the one that the splat is seen from.
    pub fn at(s: &Splat, row: f32, alpha_max: f32) -> Hit {
        let u = s.u - s.l21 * row;
        let w = s.w - s.l22 * row;
        let full = (s.exponent - u * u - w * w).exp2();
        let clamped = full > alpha_max;
        let alpha = if clamped { alpha_max } else { full };
        Hit { alpha: if full >= ALPHA_MIN { alpha } else { 0.0 }, clamped, u, w }
    }
}

/// What is left of a pixel's light behind a splat: the weight that the splat gets, and the
/// transmittance, made negative where the splat finishes the pixel.
pub fn dim(transmittance: f32, alpha: f32) -> (f32, f32) {
    let weight = alpha * transmittance;
    let next = transmittance - weight;
    if next > TRANSMITTANCE_STOP { (weight, next) } else { (0.0, -transmittance.abs()) }
}

/// First pixel of an invocation's column, of four.
pub fn first_pixel(group: UVec3, lane: u32) -> [u32; 2] {
    [group.x * TILE + lane % TILE, group.y * TILE + lane / TILE * shared::ROWS]
}

/// Centre of a pixel.
pub fn centre([x, y]: [u32; 2]) -> [f32; 2] {
    [x as f32 + 0.5, y as f32 + 0.5]
}

#[derive(Clone, Copy)]
struct Pixel {
    rgb: [f32; 3],
    depth: f32,
    /// Negative once the pixel is finished.
    transmittance: f32,
}

const EMPTY: Pixel = Pixel { rgb: [0.0; 3], depth: 0.0, transmittance: 1.0 };

fn blend(p: Pixel, s: &Splat, row: f32, alpha_max: f32) -> Pixel {
    let hit = Hit::at(s, row, alpha_max);
    let (weight, transmittance) = dim(p.transmittance, hit.alpha);
    Pixel {
        rgb: [
            p.rgb[0] + s.rgb[0] * weight,
            p.rgb[1] + s.rgb[1] * weight,
            p.rgb[2] + s.rgb[2] * weight,
        ],
        depth: p.depth + s.depth * weight,
        transmittance,
    }
}

/// Four pixels, one below the other, the first `row` below the one that the splat is seen from.
#[derive(Clone, Copy)]
struct Column([Pixel; 4]);

impl Column {
    const EMPTY: Column = Column([EMPTY; 4]);

    fn blend(self, s: &Splat, row: f32, alpha_max: f32) -> Column {
        let Column([a, b, c, d]) = self;
        Column([
            blend(a, s, row, alpha_max),
            blend(b, s, row + 1.0, alpha_max),
            blend(c, s, row + 2.0, alpha_max),
            blend(d, s, row + 3.0, alpha_max),
        ])
    }

    /// Negative where all are finished.
    fn transmittance(&self) -> f32 {
        let [a, b, c, d] = &self.0;
        max(max(a.transmittance, b.transmittance), max(c.transmittance, d.transmittance))
    }

    fn store(&self, params: &Params, out: &mut [f32], x: u32, y: u32) {
        let [a, b, c, d] = &self.0;
        store(params, out, x, y, a);
        store(params, out, x, y + 1, b);
        store(params, out, x, y + 2, c);
        store(params, out, x, y + 3, d);
    }
}

fn store(params: &Params, out: &mut [f32], x: u32, y: u32, p: &Pixel) {
    if (x < params.width) & (y < params.height) {
        let at = ((y * params.width + x) * shared::PIXEL) as usize;
        let t = p.transmittance.abs();
        out[at] = p.rgb[0] + t * params.background[0];
        out[at + 1] = p.rgb[1] + t * params.background[1];
        out[at + 2] = p.rgb[2] + t * params.background[2];
        out[at + 3] = p.depth;
        out[at + 4] = t;
    }
}

/// The range of a workgroup's tile.
pub fn range(params: &Params, ranges: &[UVec2], group: UVec3) -> UVec2 {
    // SAFETY: a workgroup a tile, a range a tile.
    unsafe { *ranges.index_unchecked((group.y * params.tiles_x + group.x) as usize) }
}

/// One workgroup a tile.
#[spirv(compute(threads(16)))]
pub fn splat(
    #[spirv(workgroup_id)] group: UVec3,
    #[spirv(local_invocation_index)] lane: u32,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] ranges: &[UVec2],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] pair_splats: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] records: &[Vec4],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] out: &mut [f32],
) {
    let [x, y] = first_pixel(group, lane);
    let range = range(params, ranges, group);
    let list = List { records, pair_splats, end: range.y, centre: centre([x, y]) };
    let alpha_max = params.alpha_max;
    let mut pixels = Column::EMPTY;
    let mut at = range.x;
    while at < range.y {
        pixels = pixels.blend(&list.load(at), 0.0, alpha_max);
        at += 1;
        if pixels.transmittance() < 0.0 {
            break;
        }
    }
    pixels.store(params, out, x, y);
}

/// The whole column of a tile.
type Whole = (Column, Column);

fn blend_whole((upper, lower): Whole, s: &Splat, alpha_max: f32) -> Whole {
    (upper.blend(s, 0.0, alpha_max), lower.blend(s, 4.0, alpha_max))
}

/// The same for subgroups of eight. One workgroup a tile.
#[spirv(compute(threads(8)))]
pub fn splat_lanes(
    #[spirv(workgroup_id)] group: UVec3,
    #[spirv(subgroup_local_invocation_id)] lane: u32,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] ranges: &[UVec2],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] pair_splats: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] records: &[Vec4],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] out: &mut [f32],
) {
    let (x, y) = (group.x * TILE, group.y * TILE);
    let range = range(params, ranges, group);
    let list = List { records, pair_splats, end: range.y, centre: centre([x, y]) };
    let (column, alpha_max) = (lane as f32, params.alpha_max);
    let mut pixels = (Column::EMPTY, Column::EMPTY);
    let mut at = range.x;
    while at < range.y {
        let own = list.load(at + lane);
        pixels = blend_whole(pixels, &own.of(0, column), alpha_max);
        pixels = blend_whole(pixels, &own.of(1, column), alpha_max);
        pixels = blend_whole(pixels, &own.of(2, column), alpha_max);
        pixels = blend_whole(pixels, &own.of(3, column), alpha_max);
        pixels = blend_whole(pixels, &own.of(4, column), alpha_max);
        pixels = blend_whole(pixels, &own.of(5, column), alpha_max);
        pixels = blend_whole(pixels, &own.of(6, column), alpha_max);
        pixels = blend_whole(pixels, &own.of(7, column), alpha_max);
        at += LANES;
        let left = max(pixels.0.transmittance(), pixels.1.transmittance());
        if largest(left, lane) < 0.0 {
            break;
        }
    }
    pixels.0.store(params, out, x + lane, y);
    pixels.1.store(params, out, x + lane, y + 4);
}
