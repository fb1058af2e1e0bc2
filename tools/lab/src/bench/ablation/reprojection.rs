//! The motion that brings points of a render onto the places at which the camera sees them.

use glam::DVec3;
use nvsprior::geometry::Twist;
use nvsprior::{Camera, Pose};

/// A point of the render, and its keypoint in the camera's picture.
#[derive(Clone, Copy, Debug)]
pub struct Pair {
    /// In the render's camera axes, the prior's unit.
    pub place: DVec3,
    /// Pixels.
    pub seen: [f64; 2],
}

/// Distance up to which a pair is taken to be right, pixels.
const INLIER: f64 = 3.0;
/// Each step sharpens the robust loss by this factor (Yang et al. 2020: 1.4).
const SHARPEN: f64 = 1.4;
/// Steps at the sharpest loss.
const LAST_STEPS: usize = 8;
/// Most that the damping is raised for a step.
const DAMPING_RAISES: usize = 8;
/// Points nearer than this share of their first depth are behind the camera, or nearly so.
const NEAREST: f64 = 0.05;

/// Projects a point; `None` if it is not in front of the camera.
fn project(camera: &Camera, p: DVec3, nearest: f64) -> Option<[f64; 2]> {
    let [fx, fy, cx, cy] = [camera.fx, camera.fy, camera.cx, camera.cy].map(f64::from);
    (p.z > nearest).then(|| [fx * p.x / p.z + cx, fy * p.y / p.z + cy])
}

/// Residual of a pair under a motion, pixels.
fn residual(camera: &Camera, motion: &Pose, pair: &Pair) -> Option<[f64; 2]> {
    let p = motion.rotation * pair.place + motion.translation;
    let [x, y] = project(camera, p, NEAREST * pair.place.z)?;
    Some([x - pair.seen[0], y - pair.seen[1]])
}

/// The motion of least reprojection error, to apply to the render's pose. Pairs may be wrong. So
/// the Geman–McClure loss starts as nearly squares and is sharpened step by step (graduated
/// non-convexity: Yang, Antonante, Tzoumas & Carlone, RA-L 2020). Each step is a damped
/// Gauss–Newton step.
pub fn fit(camera: &Camera, pairs: &[Pair]) -> Pose {
    let mut motion = Pose::IDENTITY;
    let squares = |motion: &Pose| -> Vec<f64> {
        let square = |pair| match residual(camera, motion, pair) {
            Some([x, y]) => x * x + y * y,
            None => f64::INFINITY,
        };
        pairs.iter().map(square).collect()
    };
    let inlier = INLIER * INLIER;
    let farthest = squares(&motion).into_iter().filter(|s| s.is_finite()).fold(0.0, f64::max);
    let mut bluntness = (2.0 * farthest / inlier).max(1.0);
    let mut last = 0;
    while last < LAST_STEPS {
        let weights: Vec<f64> = squares(&motion)
            .into_iter()
            .map(|s| {
                if s.is_finite() {
                    (bluntness * inlier / (s + bluntness * inlier)).powi(2)
                } else {
                    0.0
                }
            })
            .collect();
        motion = improved(camera, pairs, &weights, &motion);
        last += usize::from(bluntness <= 1.0);
        bluntness = (bluntness / SHARPEN).max(1.0);
    }
    motion
}

/// Weighted sum of squares; infinite if a weighted point is behind the camera.
fn cost(camera: &Camera, pairs: &[Pair], weights: &[f64], motion: &Pose) -> f64 {
    let of = |(pair, weight): (&Pair, &f64)| match residual(camera, motion, pair) {
        Some([x, y]) => weight * (x * x + y * y),
        None if *weight > 0.0 => f64::INFINITY,
        None => 0.0,
    };
    pairs.iter().zip(weights).map(of).sum()
}

/// The motion after a damped Gauss–Newton step; unchanged if no step makes it better.
fn improved(camera: &Camera, pairs: &[Pair], weights: &[f64], motion: &Pose) -> Pose {
    let (hessian, gradient) = equations(camera, pairs, weights, motion);
    let before = cost(camera, pairs, weights, motion);
    let mut damping = 1e-6;
    for _ in 0..DAMPING_RAISES {
        let mut damped = hessian;
        for (i, row) in damped.iter_mut().enumerate() {
            row[i] += damping * (hessian[i][i] + 1e-12);
        }
        if let Some(step) = solve(damped, gradient.map(|g| -g)) {
            let moved = motion.stepped(&step);
            if moved.is_finite() && cost(camera, pairs, weights, &moved) < before {
                return moved;
            }
        }
        damping *= 10.0;
    }
    *motion
}

/// Normal equations of the reprojection error with respect to a left perturbation of the motion.
fn equations(
    camera: &Camera,
    pairs: &[Pair],
    weights: &[f64],
    motion: &Pose,
) -> ([Twist; 6], Twist) {
    let (mut hessian, mut gradient) = ([[0.0; 6]; 6], [0.0; 6]);
    let [fx, fy] = [camera.fx, camera.fy].map(f64::from);
    for (pair, weight) in pairs.iter().zip(weights) {
        let Some(residual) = residual(camera, motion, pair) else { continue };
        let p = motion.rotation * pair.place + motion.translation;
        // Of (u, v) by the point, then of the point by (ρ, θ): dp = ρ + θ × p.
        let by_point = [
            DVec3::new(fx / p.z, 0.0, -fx * p.x / (p.z * p.z)),
            DVec3::new(0.0, fy / p.z, -fy * p.y / (p.z * p.z)),
        ];
        for (row, r) in by_point.into_iter().zip(residual) {
            let turned = p.cross(row);
            let j = [row.x, row.y, row.z, turned.x, turned.y, turned.z];
            for a in 0..6 {
                gradient[a] += weight * j[a] * r;
                for b in 0..6 {
                    hessian[a][b] += weight * j[a] * j[b];
                }
            }
        }
    }
    (hessian, gradient)
}

/// Solves a symmetric positive definite system by Cholesky's method; `None` if the matrix is not positive definite.
fn solve(a: [Twist; 6], b: Twist) -> Option<Twist> {
    let mut l = [[0.0; 6]; 6];
    for i in 0..6 {
        for j in 0..=i {
            let sum: f64 = a[i][j] - (0..j).map(|k| l[i][k] * l[j][k]).sum::<f64>();
            if i == j {
                if !(sum > 0.0) {
                    return None;
                }
                l[i][i] = sum.sqrt();
            } else {
                l[i][j] = sum / l[j][j];
            }
        }
    }
    let mut x = b;
    for i in 0..6 {
        x[i] = (x[i] - (0..i).map(|k| l[i][k] * x[k]).sum::<f64>()) / l[i][i];
    }
    for i in (0..6).rev() {
        x[i] = (x[i] - (i + 1..6).map(|k| l[k][i] * x[k]).sum::<f64>()) / l[i][i];
    }
    Some(x)
}

#[cfg(test)]
mod tests {
    use super::super::super::perturbed::even;
    use super::*;

    const CAMERA: Camera =
        Camera { width: 320, height: 180, fx: 230.0, fy: 230.0, cx: 160.0, cy: 90.0 };

    /// Pairs seen after a motion; every `wrong`th is another point's.
    fn pairs(motion: &Pose, wrong: usize) -> Vec<Pair> {
        let mut even = even(3);
        let mut next = || even.next().unwrap();
        let pair = |i: usize| {
            let place = DVec3::new(2.0 * next(), next(), 4.0 + next());
            let moved = motion.rotation * place + motion.translation;
            let mut seen = project(&CAMERA, moved, 0.0).unwrap();
            if i % wrong == wrong - 1 {
                seen = [160.0 + 150.0 * next(), 90.0 + 80.0 * next()];
            }
            Pair { place, seen }
        };
        (0..20).map(pair).collect()
    }

    #[test]
    fn finds_the_motion_though_some_pairs_are_wrong() {
        let motion = Pose::exp(&[0.4, -0.2, 0.3, 0.1, -0.15, 0.3]);
        for wrong in [100, 4] {
            let found = fit(&CAMERA, &pairs(&motion, wrong));
            let short = found.after(&motion.inverse()).log();
            assert!(short.iter().all(|v| v.abs() < 1e-3), "one in {wrong} wrong: {short:?}");
        }
    }

    #[test]
    fn too_few_or_equal_points_move_nothing_beyond_reason() {
        let pair = Pair { place: DVec3::new(0.0, 0.0, 4.0), seen: [170.0, 95.0] };
        assert!(fit(&CAMERA, &[]).is_finite());
        assert!(fit(&CAMERA, &[pair; 5]).is_finite());
    }

    #[test]
    fn cholesky_solves_and_refuses() {
        let mut a = [[0.1; 6]; 6];
        (0..6).for_each(|i| a[i][i] = 2.0 + i as f64);
        let x = solve(a, [1.0, -2.0, 3.0, 0.5, 0.0, 1.0]).unwrap();
        for (row, b) in a.iter().zip([1.0, -2.0, 3.0, 0.5, 0.0, 1.0]) {
            assert!((row.iter().zip(x).map(|(a, x)| a * x).sum::<f64>() - b).abs() < 1e-12);
        }
        assert!(solve([[1.0; 6]; 6], [1.0; 6]).is_none());
    }
}
