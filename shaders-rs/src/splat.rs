//! Stage `splat`: front-to-back blending (Kerbl et al. 2023, eq. 3). A workgroup draws a tile; an
//! invocation draws four pixels of a column, so that a splat's record is loaded once for all four.

use crate::shared::{self, ALPHA_MIN, Params, TILE, TRANSMITTANCE_STOP};
use spirv_std::glam::{UVec2, UVec3, Vec4};
use spirv_std::num_traits::Float;
use spirv_std::spirv;

/// A projected splat as its record holds it.
#[derive(Clone, Copy)]
pub struct Record {
    pub mean: [f32; 2],
    pub conic: [f32; 3],
    pub opacity: f32,
    pub rgb: [f32; 3],
    pub depth: f32,
}

impl Record {
    pub fn load(records: &[Vec4], splat: u32) -> Record {
        let at = (splat * shared::RECORD) as usize;
        let (a, b, c) = (records[at], records[at + 1], records[at + 2]);
        Record {
            mean: [a.x, a.y],
            conic: [a.z, a.w, b.x],
            opacity: b.y,
            rgb: [c.x, c.y, c.z],
            depth: c.w,
        }
    }
}

/// A splat at one pixel: its alpha (0 below the cut), whether the clamp holds it, and the factor's
/// two components of `d`, of which the conic's product `v = Q d` follows.
#[derive(Clone, Copy)]
pub struct Hit {
    pub alpha: f32,
    pub clamped: bool,
    pub u: f32,
    pub w: f32,
}

impl Hit {
    pub fn at(s: &Record, alpha_max: f32, dx: f32, dy: f32) -> Hit {
        let u = s.conic[0] * dx + s.conic[1] * dy;
        let w = s.conic[2] * dy;
        let full = s.opacity * (-0.5 * (u * u + w * w)).exp();
        let clamped = full > alpha_max;
        let alpha = if clamped { alpha_max } else { full };
        Hit { alpha: if alpha >= ALPHA_MIN { alpha } else { 0.0 }, clamped, u, w }
    }
}

/// First pixel of an invocation's column, of four.
pub fn first_pixel(group: UVec3, lane: u32) -> [u32; 2] {
    [group.x * TILE + lane % TILE, group.y * TILE + lane / TILE * shared::ROWS]
}

#[derive(Clone, Copy)]
struct Pixel {
    rgb: [f32; 3],
    depth: f32,
    transmittance: f32,
    /// 1 until the transmittance stop, then 0.
    live: f32,
}

const EMPTY: Pixel = Pixel { rgb: [0.0; 3], depth: 0.0, transmittance: 1.0, live: 1.0 };

fn blend(p: Pixel, s: &Record, alpha_max: f32, dx: f32, dy: f32) -> Pixel {
    let hit = Hit::at(s, alpha_max, dx, dy);
    let next = p.transmittance * (1.0 - hit.alpha);
    let live = if next > TRANSMITTANCE_STOP { p.live } else { 0.0 };
    let weight = hit.alpha * p.transmittance * live;
    Pixel {
        rgb: [
            p.rgb[0] + s.rgb[0] * weight,
            p.rgb[1] + s.rgb[1] * weight,
            p.rgb[2] + s.rgb[2] * weight,
        ],
        depth: p.depth + s.depth * weight,
        transmittance: p.transmittance - weight,
        live,
    }
}

fn store(params: &Params, out: &mut [f32], x: u32, y: u32, p: &Pixel) {
    if (x < params.width) & (y < params.height) {
        let at = ((y * params.width + x) * shared::PIXEL) as usize;
        out[at] = p.rgb[0] + p.transmittance * params.background[0];
        out[at + 1] = p.rgb[1] + p.transmittance * params.background[1];
        out[at + 2] = p.rgb[2] + p.transmittance * params.background[2];
        out[at + 3] = p.depth;
        out[at + 4] = p.transmittance;
    }
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
    let range = ranges[(group.y * params.tiles_x + group.x) as usize];
    let alpha_max = params.alpha_max;
    let (px, py) = (x as f32 + 0.5, y as f32 + 0.5);
    let (mut p0, mut p1, mut p2, mut p3) = (EMPTY, EMPTY, EMPTY, EMPTY);
    let mut at = range.x;
    while at < range.y {
        let s = Record::load(records, pair_splats[at as usize]);
        let (dx, dy) = (s.mean[0] - px, s.mean[1] - py);
        p0 = blend(p0, &s, alpha_max, dx, dy);
        p1 = blend(p1, &s, alpha_max, dx, dy - 1.0);
        p2 = blend(p2, &s, alpha_max, dx, dy - 2.0);
        p3 = blend(p3, &s, alpha_max, dx, dy - 3.0);
        at += 1;
        if p0.live + p1.live + p2.live + p3.live == 0.0 {
            break;
        }
    }
    store(params, out, x, y, &p0);
    store(params, out, x, y + 1, &p1);
    store(params, out, x, y + 2, &p2);
    store(params, out, x, y + 3, &p3);
}
