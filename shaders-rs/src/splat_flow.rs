//! Stage `splat_flow`: blending with the optical-flow Jacobian. Splats are small, so a pixel's colour
//! changes with the pose nearly as if all that it shows moved by the flow of the pixel's own ray:
//! twelve sums a pixel (∂C/∂u, ∂C/∂v, and both weighted by 1/z) stand for the eighteen of the exact
//! Jacobian, which follows from them after the loop.

use crate::list::{LANES, List, PRODUCT, Splat, largest};
use crate::reduce::{Scratch, Sums};
use crate::shared::{Params, TILE, max};
use crate::splat::{Hit, centre, dim, first_pixel, range};
use spirv_std::glam::{UVec2, UVec3, Vec3, Vec4};
use spirv_std::spirv;

/// Derivatives along four motions: u, v, u/z, v/z.
type Motion = Vec4;

#[derive(Clone, Copy)]
struct Pixel {
    rgb: Vec3,
    /// Negative once the pixel is finished.
    transmittance: f32,
    d_r: Motion,
    d_g: Motion,
    d_b: Motion,
    d_transmittance: Motion,
}

const EMPTY: Pixel = Pixel {
    rgb: Vec3::ZERO,
    transmittance: 1.0,
    d_r: Vec4::ZERO,
    d_g: Vec4::ZERO,
    d_b: Vec4::ZERO,
    d_transmittance: Vec4::ZERO,
};

/// Derivatives are by [`PRODUCT`] too small here.
fn blend(p: Pixel, s: &Splat, row: f32, alpha_max: f32) -> Pixel {
    let hit = Hit::at(s, row, alpha_max);
    let (weight, transmittance) = dim(p.transmittance, hit.alpha);
    // Where the splat finishes the pixel it is not counted.
    let alpha = if transmittance < 0.0 { 0.0 } else { hit.alpha };
    // dα = −α v·dμ, v = Q d; nothing moves a clamped alpha.
    let slope = if hit.clamped { 0.0 } else { -weight };
    let along_u = slope * (s.l11 * hit.u);
    let along_v = slope * (s.l21 * hit.u + s.l22 * hit.w);
    let inverse_z = s.depth;
    let front = Vec4::new(along_u, along_v, along_u * inverse_z, along_v * inverse_z);
    let d_weight = front + p.d_transmittance * alpha;
    Pixel {
        rgb: p.rgb + Vec3::from_array(s.rgb) * weight,
        transmittance,
        d_r: p.d_r + d_weight * s.rgb[0],
        d_g: p.d_g + d_weight * s.rgb[1],
        d_b: p.d_b + d_weight * s.rgb[2],
        d_transmittance: p.d_transmittance - d_weight,
    }
}

/// One channel's derivative with respect to the pose from its four motions, at the ray `(x, y)`:
/// `du = fx (ρx − x ρz)/z + fx (−xy θx + (1 + x²) θy − y θz)`, `dv` likewise.
fn pose_derivative(params: &Params, ray: [f32; 2], d: Motion) -> (Vec3, Vec3) {
    let (fx, fy) = (params.focal[0] * PRODUCT, params.focal[1] * PRODUCT);
    let (x, y) = (ray[0], ray[1]);
    let (u, v) = (fx * d.x, fy * d.y);
    let (u_z, v_z) = (fx * d.z, fy * d.w);
    let rho = Vec3::new(u_z, v_z, -(x * u_z + y * v_z));
    let theta =
        Vec3::new(-x * y * u - (1.0 + y * y) * v, (1.0 + x * x) * u + x * y * v, x * v - y * u);
    (rho, theta)
}

/// Adds one pixel to the normal equations; outside of the picture nothing.
fn add(sums: Sums, params: &Params, frame: &[f32], x: u32, y: u32, p: &Pixel) -> Sums {
    if (x >= params.width) | (y >= params.height) {
        return sums;
    }
    let at = ((y * params.width + x) * 3) as usize;
    let ray = [
        (x as f32 + 0.5 - params.principal[0]) / params.focal[0],
        (y as f32 + 0.5 - params.principal[1]) / params.focal[1],
    ];
    let t = p.transmittance.abs();
    let bg = params.background;
    let (rho, theta) = pose_derivative(params, ray, p.d_r + p.d_transmittance * bg[0]);
    let sums = sums.add(rho, theta, p.rgb.x + t * bg[0] - frame[at]);
    let (rho, theta) = pose_derivative(params, ray, p.d_g + p.d_transmittance * bg[1]);
    let sums = sums.add(rho, theta, p.rgb.y + t * bg[1] - frame[at + 1]);
    let (rho, theta) = pose_derivative(params, ray, p.d_b + p.d_transmittance * bg[2]);
    sums.add(rho, theta, p.rgb.z + t * bg[2] - frame[at + 2])
}

/// The splat with its depth turned over.
fn with_inverse_depth(s: Splat) -> Splat {
    Splat { depth: 1.0 / s.depth, ..s }
}

/// One workgroup a tile.
#[spirv(compute(threads(16)))]
pub fn splat_flow(
    #[spirv(workgroup_id)] group: UVec3,
    #[spirv(local_invocation_index)] lane: u32,
    #[spirv(workgroup)] scratch: &mut Scratch,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] ranges: &[UVec2],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] pair_splats: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] records: &[Vec4],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] frame: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] partials: &mut [f32],
) {
    let [x, y] = first_pixel(group, lane);
    let range = range(params, ranges, group);
    let list = List { records, pair_splats, end: range.y, centre: centre([x, y]) };
    let alpha_max = params.alpha_max;
    let (mut p0, mut p1, mut p2, mut p3) = (EMPTY, EMPTY, EMPTY, EMPTY);
    let mut at = range.x;
    while at < range.y {
        let s = with_inverse_depth(list.load(at));
        p0 = blend(p0, &s, 0.0, alpha_max);
        p1 = blend(p1, &s, 1.0, alpha_max);
        p2 = blend(p2, &s, 2.0, alpha_max);
        p3 = blend(p3, &s, 3.0, alpha_max);
        at += 1;
        let upper = max(p0.transmittance, p1.transmittance);
        if max(upper, max(p2.transmittance, p3.transmittance)) < 0.0 {
            break;
        }
    }
    let sums = add(Sums::ZERO, params, frame, x, y, &p0);
    let sums = add(sums, params, frame, x, y + 1, &p1);
    let sums = add(sums, params, frame, x, y + 2, &p2);
    let sums = add(sums, params, frame, x, y + 3, &p3);
    sums.store(lane, group.y * params.tiles_x + group.x, scratch, partials);
}

/// Eight splats, the nearest first.
type Eight = [Splat; LANES as usize];

fn blend_eight(p: Pixel, s: &Eight, row: f32, alpha_max: f32) -> Pixel {
    let p = blend(p, &s[0], row, alpha_max);
    let p = blend(p, &s[1], row, alpha_max);
    let p = blend(p, &s[2], row, alpha_max);
    let p = blend(p, &s[3], row, alpha_max);
    let p = blend(p, &s[4], row, alpha_max);
    let p = blend(p, &s[5], row, alpha_max);
    let p = blend(p, &s[6], row, alpha_max);
    blend(p, &s[7], row, alpha_max)
}

/// The same for subgroups of eight. One workgroup a tile.
#[spirv(compute(threads(8)))]
pub fn splat_flow_lanes(
    #[spirv(workgroup_id)] group: UVec3,
    #[spirv(subgroup_local_invocation_id)] lane: u32,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] ranges: &[UVec2],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] pair_splats: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] records: &[Vec4],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] frame: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] partials: &mut [f32],
) {
    let (x, y) = (group.x * TILE, group.y * TILE);
    let range = range(params, ranges, group);
    let list = List { records, pair_splats, end: range.y, centre: centre([x, y]) };
    let (column, alpha_max) = (lane as f32, params.alpha_max);
    let (mut p0, mut p1, mut p2, mut p3) = (EMPTY, EMPTY, EMPTY, EMPTY);
    let (mut p4, mut p5, mut p6, mut p7) = (EMPTY, EMPTY, EMPTY, EMPTY);
    let mut at = range.x;
    while at < range.y {
        let own = with_inverse_depth(list.load(at + lane));
        let eight = [
            own.of(0, column),
            own.of(1, column),
            own.of(2, column),
            own.of(3, column),
            own.of(4, column),
            own.of(5, column),
            own.of(6, column),
            own.of(7, column),
        ];
        p0 = blend_eight(p0, &eight, 0.0, alpha_max);
        p1 = blend_eight(p1, &eight, 1.0, alpha_max);
        p2 = blend_eight(p2, &eight, 2.0, alpha_max);
        p3 = blend_eight(p3, &eight, 3.0, alpha_max);
        p4 = blend_eight(p4, &eight, 4.0, alpha_max);
        p5 = blend_eight(p5, &eight, 5.0, alpha_max);
        p6 = blend_eight(p6, &eight, 6.0, alpha_max);
        p7 = blend_eight(p7, &eight, 7.0, alpha_max);
        at += LANES;
        let upper =
            max(max(p0.transmittance, p1.transmittance), max(p2.transmittance, p3.transmittance));
        let lower =
            max(max(p4.transmittance, p5.transmittance), max(p6.transmittance, p7.transmittance));
        if largest(max(upper, lower), lane) < 0.0 {
            break;
        }
    }
    let x = x + lane;
    let sums = add(Sums::ZERO, params, frame, x, y, &p0);
    let sums = add(sums, params, frame, x, y + 1, &p1);
    let sums = add(sums, params, frame, x, y + 2, &p2);
    let sums = add(sums, params, frame, x, y + 3, &p3);
    let sums = add(sums, params, frame, x, y + 4, &p4);
    let sums = add(sums, params, frame, x, y + 5, &p5);
    let sums = add(sums, params, frame, x, y + 6, &p6);
    let sums = add(sums, params, frame, x, y + 7, &p7);
    sums.store_lanes(lane, group.y * params.tiles_x + group.x, partials);
}
