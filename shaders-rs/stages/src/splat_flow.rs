//! Stage `splat_flow`: blending with the optical-flow Jacobian. Splats are small. So a pixel's colour changes with the
//! pose nearly as if all that it shows moved with the flow of the pixel's own ray. Twelve sums per pixel (∂C/∂u, ∂C/∂v,
//! and both weighted by 1/z) replace the eighteen of the exact Jacobian. The derivatives follow from them after the
//! loop.

use crate::list::{Column, LANES, List, PRODUCT, Splat, largest, tell_cut};
use crate::reduce::{Scratch, Sums};
use crate::shared::{Counters, MASKED, Params, TILE, max};
use crate::splat::{Clamp, Hits, both, dim, first_pixel, middle, range};
use spirv_std::glam::{UVec2, UVec3, Vec3, Vec4};
use spirv_std::num_traits::Float;
use spirv_std::spirv;

/// Derivatives along four motions: u, v, u/z, v/z.
type Motion = Vec4;

/// The motions of four pixels.
type Motions = [Vec4; 4];

/// Four pixels, one below the other.
#[derive(Clone, Copy)]
struct Four {
    rgb: [Vec4; 3],
    /// Negative once a pixel is finished.
    transmittance: Vec4,
    /// Derivatives are by [`PRODUCT`] too small.
    d_r: Motions,
    d_g: Motions,
    d_b: Motions,
    d_transmittance: Motions,
}

const NONE: Motions = [Vec4::ZERO; 4];

impl Four {
    const EMPTY: Four = Four {
        rgb: [Vec4::ZERO; 3],
        transmittance: Vec4::ONE,
        d_r: NONE,
        d_g: NONE,
        d_b: NONE,
        d_transmittance: NONE,
    };

    /// Blends a splat into the four pixels from `y` down. The splat's depth is inverted.
    fn blend(self, s: &Splat, column: &Column, y: f32, clamp: Clamp) -> Four {
        let hits = Hits::new(column.exponents(y), clamp, f32::exp2);
        let (weights, transmittance) = dim(self.transmittance, hits.alphas);
        // A splat that finishes the pixel is not counted.
        let alphas = both(transmittance, hits.alphas, |t, alpha| if t < 0.0 { 0.0 } else { alpha });
        // dα = −α v·dμ, v = Q d; nothing moves a clamped alpha.
        let slopes = -hits.where_free(weights, clamp);
        let [v_x, v_y] = column.pull(y);
        let (u, v) = (slopes * v_x, slopes * v_y);
        let front = [u, v, u * s.depth, v * s.depth];
        let d_weights = plus(front, self.d_transmittance, alphas);
        Four {
            rgb: [
                self.rgb[0] + weights * s.rgb[0],
                self.rgb[1] + weights * s.rgb[1],
                self.rgb[2] + weights * s.rgb[2],
            ],
            transmittance,
            d_r: plus(self.d_r, d_weights, Vec4::splat(s.rgb[0])),
            d_g: plus(self.d_g, d_weights, Vec4::splat(s.rgb[1])),
            d_b: plus(self.d_b, d_weights, Vec4::splat(s.rgb[2])),
            d_transmittance: plus(self.d_transmittance, d_weights, Vec4::NEG_ONE),
        }
    }

    /// Negative if all pixels are finished.
    fn left(&self) -> f32 {
        let t = self.transmittance;
        max(max(t.x, t.y), max(t.z, t.w))
    }

    /// Adds the pixels to the normal equations.
    fn add(&self, sums: Sums, params: &Params, frame: &[f32], x: u32, y: u32) -> Sums {
        let sums = add(sums, params, frame, x, y, &self.pixel(|v| v.x));
        let sums = add(sums, params, frame, x, y + 1, &self.pixel(|v| v.y));
        let sums = add(sums, params, frame, x, y + 2, &self.pixel(|v| v.z));
        add(sums, params, frame, x, y + 3, &self.pixel(|v| v.w))
    }

    fn pixel(&self, of: impl Fn(Vec4) -> f32) -> Pixel {
        let motion = |d: Motions| Motion::new(of(d[0]), of(d[1]), of(d[2]), of(d[3]));
        Pixel {
            rgb: Vec3::new(of(self.rgb[0]), of(self.rgb[1]), of(self.rgb[2])),
            transmittance: of(self.transmittance),
            d_r: motion(self.d_r),
            d_g: motion(self.d_g),
            d_b: motion(self.d_b),
            d_transmittance: motion(self.d_transmittance),
        }
    }
}

/// `a + b scale`.
fn plus(a: Motions, b: Motions, scale: Vec4) -> Motions {
    [a[0] + b[0] * scale, a[1] + b[1] * scale, a[2] + b[2] * scale, a[3] + b[3] * scale]
}

/// A pixel when all is blended.
struct Pixel {
    rgb: Vec3,
    transmittance: f32,
    d_r: Motion,
    d_g: Motion,
    d_b: Motion,
    d_transmittance: Motion,
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

/// Adds one pixel to the normal equations, unless it is masked or outside of the picture.
fn add(sums: Sums, params: &Params, frame: &[f32], x: u32, y: u32, p: &Pixel) -> Sums {
    if (x >= params.width) | (y >= params.height) {
        return sums;
    }
    let at = (params.frame_offset + (y * params.width + x) * 3) as usize;
    if frame[at] <= MASKED {
        return sums;
    }
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

/// The splat with its depth inverted.
fn with_inverse_depth(s: Splat) -> Splat {
    Splat { depth: 1.0 / s.depth, ..s }
}

/// One workgroup per tile.
#[spirv(compute(threads(16)))]
pub fn splat_flow(
    #[spirv(workgroup_id)] group: UVec3,
    #[spirv(local_invocation_index)] lane: u32,
    #[spirv(workgroup)] scratch: &mut Scratch,
    #[spirv(spec_constant(id = 1, default = 1))] clamp: u32,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] ranges: &[UVec2],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] pair_splats: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] records: &[Vec4],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] frame: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] partials: &mut [f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 6)] counters: &mut Counters,
) {
    let [x, y] = first_pixel(group, lane);
    let range = range(params, ranges, group);
    let list = List { records, pair_splats, end: range.y, centre: middle([x, y]) };
    let clamp = Clamp::new(params, clamp);
    let mut pixels = Four::EMPTY;
    let mut at = range.x;
    while at < range.y {
        let s = with_inverse_depth(list.load(at));
        pixels = pixels.blend(&s, &s.along(0.0), -1.5, clamp);
        at += 1;
        if pixels.left() < 0.0 {
            break;
        }
    }
    if (at < range.y) & !(pixels.left() < 0.0) {
        tell_cut(counters);
    }
    let sums = pixels.add(Sums::ZERO, params, frame, x, y);
    sums.store(lane, group.y * params.tiles_x + group.x, scratch, partials);
}

/// The form for subgroups of eight: one workgroup per tile, with two subgroups for one half of the
/// tile each. With one subgroup for all eight rows the instructions would take 40 KB, and more time, although loads
/// would halve: docs/decisions.md, 7.
#[spirv(compute(threads(16)))]
pub fn splat_flow_lockstep(
    #[spirv(workgroup_id)] group: UVec3,
    #[spirv(subgroup_id)] half: u32,
    #[spirv(subgroup_local_invocation_id)] lane: u32,
    #[spirv(workgroup)] scratch: &mut Scratch,
    #[spirv(spec_constant(id = 1, default = 1))] clamp: u32,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] ranges: &[UVec2],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] pair_splats: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] records: &[Vec4],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] frame: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] partials: &mut [f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 6)] counters: &mut Counters,
) {
    let range = range(params, ranges, group);
    let [x, y] = first_pixel(group, half * LANES + lane);
    let list = List { records, pair_splats, end: range.y, centre: middle([group.x * TILE, y]) };
    let (column, clamp) = (lane as f32, Clamp::new(params, clamp));
    let blend = |pixels: Four, s: Splat| pixels.blend(&s, &s.along(column), -1.5, clamp);
    let mut pixels = Four::EMPTY;
    let mut at = range.x;
    while at < range.y {
        let own = with_inverse_depth(list.load(at + lane));
        pixels = blend(pixels, own.of(0));
        pixels = blend(pixels, own.of(1));
        pixels = blend(pixels, own.of(2));
        pixels = blend(pixels, own.of(3));
        pixels = blend(pixels, own.of(4));
        pixels = blend(pixels, own.of(5));
        pixels = blend(pixels, own.of(6));
        pixels = blend(pixels, own.of(7));
        at += LANES;
        if largest(pixels.left(), lane) < 0.0 {
            break;
        }
    }
    if (at < range.y) & !(largest(pixels.left(), lane) < 0.0) {
        tell_cut(counters);
    }
    let sums = pixels.add(Sums::ZERO, params, frame, x, y);
    sums.store(half * LANES + lane, group.y * params.tiles_x + group.x, scratch, partials);
}
