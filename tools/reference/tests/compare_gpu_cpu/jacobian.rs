//! The twin's exact Jacobian against central differences of the twin's colours. Both are with the exact power of 2, not
//! with that of the final picture. Medians are compared, as the cuts make true jumps, which grow as the step shrinks.

use nvsprior::geometry::Twist;
use nvsprior::render::Jacobian;
use nvsprior::{Camera, Pose, Prior, RenderOptions};
use nvsprior_reference::Twin;

use crate::common::{camera, random_frame, random_pose, random_splats};

fn median(mut values: Vec<f64>) -> f64 {
    assert!(!values.is_empty());
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn unit(k: usize, size: f64) -> Twist {
    std::array::from_fn(|j| if j == k { size } else { 0.0 })
}

/// Relative errors of the Jacobian's entries along component `k` of τ.
fn errors_along(twin: &Twin, camera: &Camera, pose: &Pose, k: usize) -> Vec<f64> {
    const STEP: f64 = 1e-6;
    let at = |pose: &Pose| twin.samples(camera, pose, Jacobian::Exact);
    let samples = at(pose);
    let (ahead, behind) = (at(&pose.stepped(&unit(k, STEP))), at(&pose.stepped(&unit(k, -STEP))));
    let mut errors = Vec::new();
    for (at, sample) in samples.iter().enumerate() {
        for channel in 0..3 {
            let change = ahead[at].rgb[channel] - behind[at].rgb[channel];
            let (slope, d) = (change / (2.0 * STEP), sample.jacobian[channel][k]);
            if d.abs() > 1e-3 {
                errors.push((slope - d).abs() / d.abs());
            }
        }
    }
    errors
}

#[test]
fn exact_jacobian_by_pixel() {
    let smoothed = RenderOptions { antialiased: true, ..RenderOptions::GSPLAT };
    let lit = RenderOptions { background: [0.2, 0.5, 0.9], ..RenderOptions::INRIA };
    for (seed, options) in [(60, RenderOptions::GSPLAT), (61, smoothed), (62, lit)] {
        let prior = Prior::from_splats(random_splats(seed, 400, 3), options).unwrap();
        let twin = Twin::new(&prior);
        for k in 0..6 {
            let errors = errors_along(&twin, &camera(48, 32), &random_pose(seed), k);
            let median = median(errors);
            assert!(median < 1e-8, "seed {seed}, component {k}: median error {median:e}");
        }
    }
}

#[test]
fn gradient_of_the_error() {
    // Steps so small that hardly any pixel meets a jump.
    const STEP: f64 = 1e-8;
    let camera = camera(48, 32);
    let mut errors = Vec::new();
    for seed in 70..74 {
        let splats = random_splats(seed, 200, 2);
        let prior = Prior::from_splats(splats, RenderOptions::GSPLAT).unwrap();
        let twin = Twin::new(&prior);
        let (pose, frame) = (random_pose(seed), random_frame(seed, &camera));
        let at = |pose: &Pose| twin.normal_equations(&camera, pose, &frame, Jacobian::Exact);
        let here = at(&pose);
        for (k, slope) in here.gradient().into_iter().enumerate() {
            let ahead = at(&pose.stepped(&unit(k, STEP))).mse();
            let behind = at(&pose.stepped(&unit(k, -STEP))).mse();
            errors.push(((ahead - behind) / (2.0 * STEP) - slope).abs() / slope.abs());
        }
    }
    let median = median(errors);
    assert!(median < 1e-5, "median error {median:e}");
}
