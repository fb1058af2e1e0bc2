//! Stage `pose_jacobian`: how each splat's mean, covariance, opacity and colour change with the pose
//! (exact Jacobian only). With `T' = Exp(τ) T`, `dp = ρ + θ × p` and `dV = θ × V`.
//!
//! A splat has twelve `Vec4`s: for ρ then θ the gradients (xyz) of u, v, K₀₀, K₀₁, K₁₁ and ln α; the w components of
//! the first nine hold d(rgb)/dρ, row by row. `K = L dΣ Lᵀ` is the covariance's change, scaled by the conic's factor L.
//! Its size does not grow with the splat, while dΣ of a needle is as large as its length squared and would cancel in
//! blending.

use crate::project::{self, Splat};
use crate::shared::{self, DERIVATIVES, Params, RATIO_MIN, cross, dilated, dot};
use spirv_std::glam::{UVec3, Vec4};
use spirv_std::spirv;

/// The linearised projection of one splat. (References in a structure crash SwiftShader.)
struct Linear {
    focal: [f32; 2],
    /// The splat's centre and axes in camera coordinates.
    camera: [f32; 3],
    axes: [[f32; 3]; 3],
    /// Whether opacity is compensated for the low-pass.
    compensated: bool,
    ray: [f32; 2],
    inside: [bool; 2],
    /// Rows of `M`, shrunk as [`shared::project`] does it. The splat's axes are shrunk too.
    m0: [f32; 3],
    m1: [f32; 3],
    /// The low-pass, and what opacity does not compensate of it, at that scale.
    low_pass: f32,
    kept: f32,
    /// The conic's factor.
    l: [f32; 3],
    /// First row of `L M`.
    n0: [f32; 3],
}

impl Linear {
    fn new(params: &Params, splat: &Splat) -> Linear {
        let (ray, inside) = shared::clamped_ray(params, splat.camera);
        let (m0, m1) = shared::projected_axes(params, splat.camera[2], ray, &splat.axes);
        let s = shared::shrinkage(m0, m1);
        let [x, y, z] = splat.axes;
        let axes = [shared::scaled(x, s), shared::scaled(y, s), shared::scaled(z, s)];
        let (m0, m1) = (shared::scaled(m0, s), shared::scaled(m1, s));
        let (low_pass, kept) = (params.dilation * s * s, params.dilation_kept * s * s);
        let minors = cross(m0, m1);
        let (a, c) = (dot(m0, m0), dot(m1, m1));
        let det = dilated(dot(minors, minors), a + c, low_pass);
        let l = shared::conic(dot(m0, m1), c + low_pass, det);
        // `l11 m0 + l21 m1` by the triple product: in the plain sum a needle's length would cancel.
        let across = cross(m1, minors);
        let scale = l[0] / (c + low_pass);
        let along = |k: usize| scale * (across[k] + low_pass * m0[k]);
        let n0 = [along(0), along(1), along(2)];
        let (focal, camera) = (params.focal, splat.camera);
        let compensated = params.dilation_kept < params.dilation;
        Linear { focal, camera, axes, compensated, ray, inside, m0, m1, low_pass, kept, l, n0 }
    }
}

/// Derivatives along one motion: u, v, K₀₀, K₀₁, K₁₁, ln α.
type Along = [f32; 6];

impl Linear {
    /// Derivative of one row of `M`, `m = f/z (V_k − ray V_z)`.
    fn row(&self, k: usize, m: [f32; 3], dp: [f32; 3], turned: &[[f32; 3]; 3]) -> [f32; 3] {
        let z = self.camera[2];
        let scale = self.focal[k] / z;
        let ray = self.ray[k];
        let d_ray = if self.inside[k] { dp[k] / z - ray * (dp[2] / z) } else { 0.0 };
        let along = |a: usize| {
            -m[a] * (dp[2] / z)
                + scale * (turned[a][k] - ray * turned[a][2] - d_ray * self.axes[a][2])
        };
        [along(0), along(1), along(2)]
    }

    /// Derivatives along the motion that moves the centre by `dp` and turns the axes to `turned`.
    fn along(&self, dp: [f32; 3], turned: &[[f32; 3]; 3]) -> Along {
        let p = self.camera;
        let (fx, fy) = (self.focal[0], self.focal[1]);
        let z = p[2];
        let d0 = self.row(0, self.m0, dp, turned);
        let d1 = self.row(1, self.m1, dp, turned);
        let d_trace = 2.0 * (dot(self.m0, d0) + dot(self.m1, d1));
        let (n0, n1) = (self.n0, shared::scaled(self.m1, self.l[2]));
        let (e0, e1) = self.whitened(d0, d1);
        [
            // Quotients first: the products of far points are beyond f32.
            fx * (dp[0] / z - p[0] / z * (dp[2] / z)),
            fy * (dp[1] / z - p[1] / z * (dp[2] / z)),
            2.0 * dot(n0, e0),
            dot(n0, e1) + dot(n1, e0),
            2.0 * dot(n1, e1),
            self.ln_alpha(d0, d1, d_trace),
        ]
    }

    /// The factor times two rows.
    fn whitened(&self, r0: [f32; 3], r1: [f32; 3]) -> ([f32; 3], [f32; 3]) {
        let [l11, l21, l22] = self.l;
        let along = |a: usize| l11 * r0[a] + l21 * r1[a];
        ([along(0), along(1), along(2)], shared::scaled(r1, l22))
    }

    /// Derivative of the logarithm of opacity's compensation `√(det_kept/det)`.
    fn ln_alpha(&self, d0: [f32; 3], d1: [f32; 3], d_trace: f32) -> f32 {
        let minors = cross(self.m0, self.m1);
        let det0 = dot(minors, minors);
        let trace = dot(self.m0, self.m0) + dot(self.m1, self.m1);
        let (low_pass, kept) = (self.low_pass, self.kept);
        let (det, det_kept) = (dilated(det0, trace, low_pass), dilated(det0, trace, kept));
        if !self.compensated | !(det_kept > RATIO_MIN * det) {
            return 0.0;
        }
        let d_det0 = 2.0 * (dot(minors, cross(d0, self.m1)) + dot(minors, cross(self.m0, d1)));
        0.5 * ((d_det0 + kept * d_trace) / det_kept - (d_det0 + low_pass * d_trace) / det)
    }

    fn translation(&self, axis: [f32; 3]) -> Along {
        self.along(axis, &[[0.0; 3]; 3])
    }

    fn rotation(&self, axis: [f32; 3]) -> Along {
        let v = &self.axes;
        let turned = [cross(axis, v[0]), cross(axis, v[1]), cross(axis, v[2])];
        self.along(cross(axis, self.camera), &turned)
    }
}

const X: [f32; 3] = [1.0, 0.0, 0.0];
const Y: [f32; 3] = [0.0, 1.0, 0.0];
const Z: [f32; 3] = [0.0, 0.0, 1.0];

/// Gradient of the spherical harmonics with respect to the (unnormalised) direction, times the
/// coefficients: d(rgb)/d(x, y, z).
fn sh_gradient(params: &Params, sh_degree: u32, sh: &[f32], i: u32, d: [f32; 3]) -> [[f32; 3]; 3] {
    let basis = shared::sh_basis_gradient(d);
    let mut out = [[0.0; 3]; 3];
    let count = shared::sh_coefficients(sh_degree);
    let mut k = 1;
    while k < count {
        let b = basis[k as usize];
        let rgb = project::coefficients(params, sh, k / 2, i)[(k % 2) as usize];
        out = [
            [out[0][0] + b[0] * rgb[0], out[0][1] + b[1] * rgb[0], out[0][2] + b[2] * rgb[0]],
            [out[1][0] + b[0] * rgb[1], out[1][1] + b[1] * rgb[1], out[1][2] + b[2] * rgb[1]],
            [out[2][0] + b[0] * rgb[2], out[2][1] + b[1] * rgb[2], out[2][2] + b[2] * rgb[2]],
        ];
        k += 1;
    }
    out
}

/// d(colour)/dρ of one channel: `(I − d̂d̂ᵀ) Rᵀ / ‖·‖`, turned into camera axes. The centre moves by −Rᵀρ, so the point
/// moves by +Rᵀρ relative to it.
fn colour_derivative(params: &Params, d: [f32; 3], inverse: f32, gradient: [f32; 3]) -> [f32; 3] {
    let radial = dot(gradient, d);
    let tangent = [
        (gradient[0] - radial * d[0]) * inverse,
        (gradient[1] - radial * d[1]) * inverse,
        (gradient[2] - radial * d[2]) * inverse,
    ];
    shared::transform(&params.rotation, tangent)
}

fn with(xyz: [f32; 3], w: f32) -> Vec4 {
    Vec4::new(xyz[0], xyz[1], xyz[2], w)
}

/// The splat that shows nothing does not move either.
fn clear(derivatives: &mut [Vec4], i: usize) {
    let mut k = 0;
    while k < DERIVATIVES as usize {
        derivatives[i * DERIVATIVES as usize + k] = Vec4::ZERO;
        k += 1;
    }
}

/// One invocation per splat, and one more for the splat that shows nothing; culled splats are left out.
#[spirv(compute(threads(256)))]
pub fn pose_jacobian(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(spec_constant(id = 0, default = 3))] sh_degree: u32,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] geometry: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] sh: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] records: &[Vec4],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] keys: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] derivatives: &mut [Vec4],
) {
    let i = id.x as usize;
    if id.x >= params.splats {
        if id.x == params.splats {
            clear(derivatives, i);
        }
        return;
    }
    if keys[i] == shared::CULLED {
        return;
    }
    let splat = project::load(params, geometry, id.x);
    let world = splat.world;
    let linear = Linear::new(params, &splat);
    let (tx, ty, tz) = (linear.translation(X), linear.translation(Y), linear.translation(Z));
    let (rx, ry, rz) = (linear.rotation(X), linear.rotation(Y), linear.rotation(Z));

    let (d, inverse) = shared::direction(params, world);
    let gradient = sh_gradient(params, sh_degree, sh, id.x, d);
    let colour = records[i * shared::RECORD as usize + 2];
    // A colour that is clamped at 0 does not change.
    let mut red = colour_derivative(params, d, inverse, gradient[0]);
    let mut green = colour_derivative(params, d, inverse, gradient[1]);
    let mut blue = colour_derivative(params, d, inverse, gradient[2]);
    if !(colour.x > 0.0) {
        red = [0.0; 3];
    }
    if !(colour.y > 0.0) {
        green = [0.0; 3];
    }
    if !(colour.z > 0.0) {
        blue = [0.0; 3];
    }

    let at = i * DERIVATIVES as usize;
    derivatives[at] = with([tx[0], ty[0], tz[0]], red[0]);
    derivatives[at + 1] = with([rx[0], ry[0], rz[0]], red[1]);
    derivatives[at + 2] = with([tx[1], ty[1], tz[1]], red[2]);
    derivatives[at + 3] = with([rx[1], ry[1], rz[1]], green[0]);
    derivatives[at + 4] = with([tx[2], ty[2], tz[2]], green[1]);
    derivatives[at + 5] = with([rx[2], ry[2], rz[2]], green[2]);
    derivatives[at + 6] = with([tx[3], ty[3], tz[3]], blue[0]);
    derivatives[at + 7] = with([rx[3], ry[3], rz[3]], blue[1]);
    derivatives[at + 8] = with([tx[4], ty[4], tz[4]], blue[2]);
    derivatives[at + 9] = with([rx[4], ry[4], rz[4]], 0.0);
    derivatives[at + 10] = with([tx[5], ty[5], tz[5]], 0.0);
    derivatives[at + 11] = with([rx[5], ry[5], rz[5]], 0.0);
}
