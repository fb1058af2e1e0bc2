//! Stage `splat_flow`: blending with the optical-flow Jacobian. Splats are small, so a pixel's colour
//! changes with the pose nearly as if all that it shows moved by the flow of the pixel's own ray:
//! twelve sums a pixel (∂C/∂u, ∂C/∂v, and both weighted by 1/z) stand for the eighteen of the exact
//! Jacobian, which follows from them after the loop.

use crate::reduce::{Scratch, Sums};
use crate::shared::{Params, TRANSMITTANCE_STOP};
use crate::splat::{Hit, Record, first_pixel};
use spirv_std::glam::{UVec2, UVec3, Vec3, Vec4};
use spirv_std::spirv;

/// Derivatives along four motions: u, v, u/z, v/z.
type Motion = Vec4;

#[derive(Clone, Copy)]
struct Pixel {
    rgb: Vec3,
    transmittance: f32,
    live: f32,
    d_r: Motion,
    d_g: Motion,
    d_b: Motion,
    d_transmittance: Motion,
}

const EMPTY: Pixel = Pixel {
    rgb: Vec3::ZERO,
    transmittance: 1.0,
    live: 1.0,
    d_r: Vec4::ZERO,
    d_g: Vec4::ZERO,
    d_b: Vec4::ZERO,
    d_transmittance: Vec4::ZERO,
};

fn blend(p: Pixel, s: &Record, inverse_z: f32, alpha_max: f32, dx: f32, dy: f32) -> Pixel {
    let hit = Hit::at(s, alpha_max, dx, dy);
    let next = p.transmittance * (1.0 - hit.alpha);
    let live = if next > TRANSMITTANCE_STOP { p.live } else { 0.0 };
    let alpha = hit.alpha * live;
    let weight = alpha * p.transmittance;
    // dα = −α v·dμ, v = Q d; nothing moves a clamped alpha.
    let slope = if hit.clamped { 0.0 } else { -alpha };
    let along_u = slope * s.conic[0] * hit.u;
    let along_v = slope * (s.conic[1] * hit.u + s.conic[2] * hit.w);
    let d_alpha = Vec4::new(along_u, along_v, along_u * inverse_z, along_v * inverse_z);
    let front = d_alpha * p.transmittance;
    let d_weight = front + p.d_transmittance * alpha;
    Pixel {
        rgb: p.rgb + Vec3::from_array(s.rgb) * weight,
        transmittance: p.transmittance - weight,
        live,
        d_r: p.d_r + d_weight * s.rgb[0],
        d_g: p.d_g + d_weight * s.rgb[1],
        d_b: p.d_b + d_weight * s.rgb[2],
        d_transmittance: p.d_transmittance - d_weight,
    }
}

/// One channel's derivative with respect to the pose from its four motions, at the ray `(x, y)`:
/// `du = fx (ρx − x ρz)/z + fx (−xy θx + (1 + x²) θy − y θz)`, `dv` likewise.
fn pose_derivative(params: &Params, ray: [f32; 2], d: Motion) -> (Vec3, Vec3) {
    let (fx, fy) = (params.focal[0], params.focal[1]);
    let (x, y) = (ray[0], ray[1]);
    let (u, v) = (fx * d.x, fy * d.y);
    let (u_z, v_z) = (fx * d.z, fy * d.w);
    let rho = Vec3::new(u_z, v_z, -(x * u_z + y * v_z));
    let theta = Vec3::new(
        -x * y * u - (1.0 + y * y) * v,
        (1.0 + x * x) * u + x * y * v,
        x * v - y * u,
    );
    (rho, theta)
}

/// Adds one pixel to the normal equations; outside of the picture nothing.
fn add(sums: Sums, params: &Params, frame: &[f32], x: u32, y: u32, p: &Pixel) -> Sums {
    if (x >= params.width) | (y >= params.height) {
        return sums;
    }
    let at = (params.frame_offset + (y * params.width + x) * 3) as usize;
    let ray = [
        (x as f32 + 0.5 - params.principal[0]) / params.focal[0],
        (y as f32 + 0.5 - params.principal[1]) / params.focal[1],
    ];
    let t = p.transmittance;
    let bg = params.background;
    let (rho, theta) = pose_derivative(params, ray, p.d_r + p.d_transmittance * bg[0]);
    let sums = sums.add(rho, theta, p.rgb.x + t * bg[0] - frame[at]);
    let (rho, theta) = pose_derivative(params, ray, p.d_g + p.d_transmittance * bg[1]);
    let sums = sums.add(rho, theta, p.rgb.y + t * bg[1] - frame[at + 1]);
    let (rho, theta) = pose_derivative(params, ray, p.d_b + p.d_transmittance * bg[2]);
    sums.add(rho, theta, p.rgb.z + t * bg[2] - frame[at + 2])
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
    let tile = group.y * params.tiles_x + group.x;
    let range = ranges[tile as usize];
    let alpha_max = params.alpha_max;
    let (px, py) = (x as f32 + 0.5, y as f32 + 0.5);
    let (mut p0, mut p1, mut p2, mut p3) = (EMPTY, EMPTY, EMPTY, EMPTY);
    let mut at = range.x;
    while at < range.y {
        let s = Record::load(records, pair_splats[at as usize]);
        let (dx, dy) = (s.mean[0] - px, s.mean[1] - py);
        let inverse_z = 1.0 / s.depth;
        p0 = blend(p0, &s, inverse_z, alpha_max, dx, dy);
        p1 = blend(p1, &s, inverse_z, alpha_max, dx, dy - 1.0);
        p2 = blend(p2, &s, inverse_z, alpha_max, dx, dy - 2.0);
        p3 = blend(p3, &s, inverse_z, alpha_max, dx, dy - 3.0);
        at += 1;
        if p0.live + p1.live + p2.live + p3.live == 0.0 {
            break;
        }
    }
    let sums = add(Sums::ZERO, params, frame, x, y, &p0);
    let sums = add(sums, params, frame, x, y + 1, &p1);
    let sums = add(sums, params, frame, x, y + 2, &p2);
    let sums = add(sums, params, frame, x, y + 3, &p3);
    sums.store(lane, tile, scratch, partials);
}
