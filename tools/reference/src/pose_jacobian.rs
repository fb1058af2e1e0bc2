//! Twin of stage `pose_jacobian`: how a splat's mean, covariance, opacity and colour change with the pose.
//! With `T' = Exp(τ) T`: `dp = ρ + θ × p`, `dΣ_c = [θ]× Σ_c + Σ_c [θ]×ᵀ`.

use glam::{DMat2, DMat3, DVec2, DVec3};

use nvsprior_kernels::shared::RATIO_MIN;

use super::project::{Linearisation, Projected, Splat};
use super::{Twist, Viewpoint, harmonics};

/// Pose derivatives of a projected splat.
#[derive(Clone, Copy, Debug, Default)]
pub struct Motion {
    /// Derivatives of the mean, u and v.
    pub mean: [Twist; 2],
    /// Derivatives of the 2D covariance, Σ₀₀, Σ₀₁, Σ₁₁.
    pub covariance: [Twist; 3],
    /// Derivative of the logarithm of the opacity.
    pub ln_alpha: Twist,
    pub rgb: [Twist; 3],
}

/// A motion of the camera along one component of τ.
#[derive(Clone, Copy)]
struct Along {
    rho: DVec3,
    theta: DVec3,
}

/// Differentiates what [`project`](super::project::project) computes.
pub fn derive(view: &Viewpoint, splat: &Splat, s: &Projected) -> Motion {
    let sigma = splat.camera_covariance(view);
    let linear = Linearisation::at(view, s.camera);
    let sharp = linear.covariance(&sigma);
    let rgb = colour(view, splat, s);
    let mut motion = Motion::default();
    for k in 0..6 {
        let axis = DVec3::AXES[k % 3];
        let along = if k < 3 {
            Along { rho: axis, theta: DVec3::ZERO }
        } else {
            Along { rho: DVec3::ZERO, theta: axis }
        };
        let mean = d_mean(view, s.camera, along);
        let covariance = d_covariance(view, s.camera, &linear, &sigma, along);
        motion.mean[0][k] = mean.x;
        motion.mean[1][k] = mean.y;
        motion.covariance[0][k] = covariance.x_axis.x;
        motion.covariance[1][k] = covariance.x_axis.y;
        motion.covariance[2][k] = covariance.y_axis.y;
        motion.ln_alpha[k] = d_ln_alpha(view, &sharp, &s.covariance, &covariance);
        for (to, gradient) in motion.rgb.iter_mut().zip(&rgb) {
            to[k] = gradient.dot(along.rho);
        }
    }
    motion
}

fn d_point(p: DVec3, along: Along) -> DVec3 {
    along.rho + along.theta.cross(p)
}

/// Derivative of the mean, without the clamp of the ray.
fn d_mean(view: &Viewpoint, p: DVec3, along: Along) -> DVec2 {
    let dp = d_point(p, along);
    let (fx, fy) = (f64::from(view.camera.fx), f64::from(view.camera.fy));
    DVec2::new(fx * (dp.x - p.x / p.z * dp.z) / p.z, fy * (dp.y - p.y / p.z * dp.z) / p.z)
}

/// `dΣ' = dJ Σ Jᵀ + J Σ dJᵀ + J dΣ Jᵀ`.
fn d_covariance(
    view: &Viewpoint,
    p: DVec3,
    linear: &Linearisation,
    sigma: &DMat3,
    along: Along,
) -> DMat2 {
    let dp = d_point(p, along);
    let focal = [f64::from(view.camera.fx), f64::from(view.camera.fy)];
    let d_row = |k: usize| {
        let (ray, f) = (linear.ray[k], focal[k]);
        let d_ray = if linear.inside[k] { (dp[k] - p[k] / p.z * dp.z) / p.z } else { 0.0 };
        let d_scale = -f * dp.z / (p.z * p.z);
        let mut row = DVec3::ZERO;
        row[k] = d_scale;
        row.z = -d_scale * ray - f / p.z * d_ray;
        row
    };
    let d_rows = [d_row(0), d_row(1)];
    let turn = DMat3::from_cols(
        along.theta.cross(DVec3::X),
        along.theta.cross(DVec3::Y),
        along.theta.cross(DVec3::Z),
    );
    let d_sigma = turn * *sigma + *sigma * turn.transpose();
    let j = linear.rows;
    let entry = |a: usize, b: usize| {
        d_rows[a].dot(*sigma * j[b]) + j[a].dot(*sigma * d_rows[b]) + j[a].dot(d_sigma * j[b])
    };
    DMat2::from_cols_array(&[entry(0, 0), entry(0, 1), entry(1, 0), entry(1, 1)])
}

/// The change of `ln √(det Σ′ / det Σ⁺)`, if opacity compensates. Low-passes are constant, so both
/// covariances change by the same `d`.
fn d_ln_alpha(view: &Viewpoint, sharp: &DMat2, smooth: &DMat2, d: &DMat2) -> f64 {
    let [added, kept] = view.low_pass;
    let sharp = *sharp + DMat2::from_diagonal(DVec2::splat(kept.into()));
    let ratio = sharp.determinant() / smooth.determinant();
    if !(kept < added && ratio > RATIO_MIN.into()) {
        return 0.0;
    }
    // d ln det A = tr(A⁻¹ dA).
    let d_ln_det = |a: &DMat2| {
        let product = a.inverse() * *d;
        product.x_axis.x + product.y_axis.y
    };
    0.5 * (d_ln_det(&sharp) - d_ln_det(smooth))
}

/// d(rgb)/dρ, `R (I − d̂d̂ᵀ) / ‖·‖` times the harmonics' gradient; θ does not move the camera's
/// centre. A channel that is clamped at 0 does not change.
fn colour(view: &Viewpoint, splat: &Splat, s: &Projected) -> [DVec3; 3] {
    let (d, distance) = splat.direction(view);
    let (_, gradients) = harmonics::evaluate(splat.sh, d);
    std::array::from_fn(|channel| {
        if !(s.rgb[channel] > 0.0) {
            return DVec3::ZERO;
        }
        let g = gradients[channel];
        view.pose.matrix() * ((g - d * d.dot(g)) / distance)
    })
}
