//! Stage `splat_exact`: blending with the exact pose Jacobian of what is drawn (order, tile lists and
//! cuts held fixed): `dα = α (d ln α − v·dμ + ½ wᵀ K w)`, `dC += c (T dα + α dT) + α T dc`,
//! `dT ← (1 − α) dT − T dα`.

use crate::blend::{Clamp, Place};
use crate::list::tell_cut;
use crate::reduce::{Channel, Channels, Scratch, store};
use crate::shared::{
    Counters, DERIVATIVES, LOG_ALPHA_MIN, MASKED, Params, RECORD, ROWS, TRANSMITTANCE_STOP,
};
use spirv_std::glam::{UVec2, UVec3, Vec3, Vec4, Vec4Swizzles};
use spirv_std::num_traits::Float;
use spirv_std::spirv;

/// A projected splat as its record holds it.
#[derive(Clone, Copy)]
struct Record {
    mean: [f32; 2],
    conic: [f32; 3],
    log_opacity: f32,
    rgb: [f32; 3],
}

impl Record {
    fn load(records: &[Vec4], splat: u32) -> Record {
        let at = (splat * RECORD) as usize;
        let (a, b, c) = (records[at], records[at + 1], records[at + 2]);
        Record { mean: [a.x, a.y], conic: [a.z, a.w, b.x], log_opacity: b.y, rgb: [c.x, c.y, c.z] }
    }
}

/// A splat at one pixel: its alpha (0 below the cut), whether it is clamped, and the factor's two
/// components of `d`, which give the conic's product `v = Q d`.
#[derive(Clone, Copy)]
struct Hit {
    alpha: f32,
    clamped: bool,
    u: f32,
    w: f32,
}

impl Hit {
    fn at(s: &Record, clamp: Clamp, dx: f32, dy: f32) -> Hit {
        let u = s.conic[0] * dx + s.conic[1] * dy;
        let w = s.conic[2] * dy;
        let exponent = s.log_opacity - 0.5 * core::f32::consts::LOG2_E * (u * u + w * w);
        let full = exponent.exp2();
        let (clamped, alpha) = (clamp.holds(full), clamp.of(full));
        Hit { alpha: if exponent >= LOG_ALPHA_MIN { alpha } else { 0.0 }, clamped, u, w }
    }
}

/// A derivative with respect to the pose, ρ then θ.
#[derive(Clone, Copy)]
struct Twist {
    rho: Vec3,
    theta: Vec3,
}

impl Twist {
    const ZERO: Twist = Twist { rho: Vec3::ZERO, theta: Vec3::ZERO };

    fn plus(self, other: Twist, scale: f32) -> Twist {
        Twist { rho: self.rho + other.rho * scale, theta: self.theta + other.theta * scale }
    }
}

/// What stage `pose_jacobian` wrote of one splat.
#[derive(Clone, Copy)]
struct Derivatives {
    u: Twist,
    v: Twist,
    k00: Twist,
    k01: Twist,
    k11: Twist,
    ln_alpha: Twist,
    red: Vec3,
    green: Vec3,
    blue: Vec3,
}

impl Derivatives {
    fn load(derivatives: &[Vec4], splat: u32) -> Derivatives {
        let at = (splat * DERIVATIVES) as usize;
        let (a, b, c) = (derivatives[at], derivatives[at + 1], derivatives[at + 2]);
        let (d, e, f) = (derivatives[at + 3], derivatives[at + 4], derivatives[at + 5]);
        let (g, h, i) = (derivatives[at + 6], derivatives[at + 7], derivatives[at + 8]);
        let (j, k, l) = (derivatives[at + 9], derivatives[at + 10], derivatives[at + 11]);
        Derivatives {
            u: Twist { rho: a.xyz(), theta: b.xyz() },
            v: Twist { rho: c.xyz(), theta: d.xyz() },
            k00: Twist { rho: e.xyz(), theta: f.xyz() },
            k01: Twist { rho: g.xyz(), theta: h.xyz() },
            k11: Twist { rho: i.xyz(), theta: j.xyz() },
            ln_alpha: Twist { rho: k.xyz(), theta: l.xyz() },
            red: Vec3::new(a.w, b.w, c.w),
            green: Vec3::new(d.w, e.w, f.w),
            blue: Vec3::new(g.w, h.w, i.w),
        }
    }
}

#[derive(Clone, Copy)]
struct Pixel {
    rgb: Vec3,
    transmittance: f32,
    d_r: Twist,
    d_g: Twist,
    d_b: Twist,
    d_transmittance: Twist,
}

const EMPTY: Pixel = Pixel {
    rgb: Vec3::ZERO,
    transmittance: 1.0,
    d_r: Twist::ZERO,
    d_g: Twist::ZERO,
    d_b: Twist::ZERO,
    d_transmittance: Twist::ZERO,
};

impl Pixel {
    /// Whether further splats count.
    fn is_open(&self) -> bool {
        self.transmittance > TRANSMITTANCE_STOP
    }
}

fn blend(p: Pixel, s: &Record, d: &Derivatives, clamp: Clamp, dx: f32, dy: f32) -> Pixel {
    let hit = Hit::at(s, clamp, dx, dy);
    let alpha = if p.is_open() { hit.alpha } else { 0.0 };
    let weight = alpha * p.transmittance;
    let slope = if hit.clamped { 0.0 } else { alpha };
    let v0 = s.conic[0] * hit.u;
    let v1 = s.conic[1] * hit.u + s.conic[2] * hit.w;
    let d_ln = d
        .ln_alpha
        .plus(d.u, -v0)
        .plus(d.v, -v1)
        .plus(d.k00, 0.5 * hit.u * hit.u)
        .plus(d.k01, hit.u * hit.w)
        .plus(d.k11, 0.5 * hit.w * hit.w);
    let d_weight = Twist::ZERO.plus(d_ln, slope * p.transmittance).plus(p.d_transmittance, alpha);
    let channel = |before: Twist, colour: f32, d_colour: Vec3| {
        let moved = before.plus(d_weight, colour);
        Twist { rho: moved.rho + d_colour * weight, theta: moved.theta }
    };
    Pixel {
        rgb: p.rgb + Vec3::from_array(s.rgb) * weight,
        transmittance: p.transmittance - weight,
        d_r: channel(p.d_r, s.rgb[0], d.red),
        d_g: channel(p.d_g, s.rgb[1], d.green),
        d_b: channel(p.d_b, s.rgb[2], d.blue),
        d_transmittance: p.d_transmittance.plus(d_weight, -1.0),
    }
}

/// What one pixel adds to the normal equations: nothing if it is masked or outside of the picture.
fn channels(params: &Params, frame: &[f32], x: u32, y: u32, p: &Pixel) -> Channels<f32> {
    let inside = (x < params.width) & (y < params.height);
    let (x, y) = (x.min(params.width - 1), y.min(params.height - 1));
    let first = (params.frame_offset + (y * params.width + x) * 3) as usize;
    let counted = inside & (frame[first] > MASKED);
    let (transmittance, d_transmittance) = (p.transmittance, p.d_transmittance);
    let channel = |background: f32, frame: f32, rgb: f32, d: Twist| {
        let d = d.plus(d_transmittance, background);
        let residual = rgb + transmittance * background - frame;
        let all = [d.rho.x, d.rho.y, d.rho.z, d.theta.x, d.theta.y, d.theta.z, residual];
        if counted { all } else { [0.0; 7] }
    };
    let [r, g, b] = params.background;
    [
        channel(r, frame[first], p.rgb.x, p.d_r),
        channel(g, frame[first + 1], p.rgb.y, p.d_g),
        channel(b, frame[first + 2], p.rgb.z, p.d_b),
    ]
}

/// One channel of four pixels.
fn four(k: usize, of: &[Channels<f32>; 4]) -> Channel<Vec4> {
    let column = |i: usize| Vec4::new(of[0][k][i], of[1][k][i], of[2][k][i], of[3][k][i]);
    [column(0), column(1), column(2), column(3), column(4), column(5), column(6)]
}

/// One workgroup per tile.
#[spirv(compute(threads(16)))]
pub fn splat_exact(
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
    #[spirv(storage_buffer, descriptor_set = 0, binding = 6)] derivatives: &[Vec4],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 7)] counters: &mut Counters,
) {
    let [x, y] = Place::of_group(group, lane, ROWS).in_picture(params).pixel();
    let tile = group.y * params.tiles_x + group.x;
    let range = ranges[tile as usize];
    let clamp = Clamp::new(params, clamp);
    let (px, py) = (x as f32 + 0.5, y as f32 + 0.5);
    let (mut p0, mut p1, mut p2, mut p3) = (EMPTY, EMPTY, EMPTY, EMPTY);
    let mut at = range.x;
    while at < range.y {
        let splat = pair_splats[at as usize];
        let s = Record::load(records, splat);
        let d = Derivatives::load(derivatives, splat);
        let (dx, dy) = (s.mean[0] - px, s.mean[1] - py);
        p0 = blend(p0, &s, &d, clamp, dx, dy);
        p1 = blend(p1, &s, &d, clamp, dx, dy - 1.0);
        p2 = blend(p2, &s, &d, clamp, dx, dy - 2.0);
        p3 = blend(p3, &s, &d, clamp, dx, dy - 3.0);
        at += 1;
        if !(p0.is_open() | p1.is_open() | p2.is_open() | p3.is_open()) {
            break;
        }
    }
    if (at < range.y) & (p0.is_open() | p1.is_open() | p2.is_open() | p3.is_open()) {
        tell_cut(counters);
    }
    let all = [
        channels(params, frame, x, y, &p0),
        channels(params, frame, x, y + 1, &p1),
        channels(params, frame, x, y + 2, &p2),
        channels(params, frame, x, y + 3, &p3),
    ];
    store(&[four(0, &all), four(1, &all), four(2, &all)], lane, tile, scratch, partials);
}
