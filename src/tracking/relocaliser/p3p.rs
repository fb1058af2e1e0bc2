//! Poses of a calibrated camera from three points: Lambda Twist (Persson & Nordberg, ECCV 2018).

use glam::{DMat3, DQuat, DVec3};

use crate::Pose;

/// Most poses of a call.
pub const MAX: usize = 4;

/// World-to-camera poses that see each of the three world `points` along its ray (camera axes, of any length but zero).
/// There are at most four, and none if the points lie on a line; the rest are `None`.
pub fn poses(rays: [DVec3; 3], points: [DVec3; 3]) -> [Option<Pose>; MAX] {
    let mut found = [None; MAX];
    let mut count = 0;
    let [y1, y2, y3] = rays.map(DVec3::normalize);
    for [l1, l2, l3] in depths([y1, y2, y3], points).into_iter().flatten() {
        let seen = [y1 * l1, y2 * l2, y3 * l3];
        if let Some(pose) = motion(points, seen).filter(|_| count < MAX) {
            found[count] = Some(pose);
            count += 1;
        }
    }
    found
}

/// Distances of the three points along unit rays: section 4 of the paper.
fn depths([y1, y2, y3]: [DVec3; 3], [x1, x2, x3]: [DVec3; 3]) -> [Option<[f64; 3]>; MAX] {
    let (b12, b13, b23) = (-2.0 * y1.dot(y2), -2.0 * y1.dot(y3), -2.0 * y2.dot(y3));
    let (a12, a13, a23) =
        ((x1 - x2).length_squared(), (x1 - x3).length_squared(), (x2 - x3).length_squared());
    let Some(g) = cubic(a12, a13, a23, b12, b13, b23) else { return [None; MAX] };
    // The degenerate conic of the pencil: a rank-two matrix with eigenvalues of both signs.
    let conic = [
        [a23 * (1.0 - g), a23 * b12 * 0.5, a23 * b13 * g * -0.5],
        [a23 * b12 * 0.5, a23 - a12 + a13 * g, b23 * (a13 * g - a12) * 0.5],
        [a23 * b13 * g * -0.5, b23 * (a13 * g - a12) * 0.5, g * (a13 - a23) - a12],
    ];
    let Some((values, v)) = eigen_known_zero(&conic) else { return [None; MAX] };
    let ratio = (-values[1] / values[0]).max(0.0).sqrt();
    let mut found = [None; MAX];
    for (slot, s) in [ratio, -ratio].into_iter().enumerate() {
        let w2 = 1.0 / (s * v[1].x - v[0].x);
        let w0 = (v[0].y - s * v[1].y) * w2;
        let w1 = (v[0].z - s * v[1].z) * w2;
        let a = 1.0 / ((a13 - a12) * w1 * w1 - a12 * b13 * w1 - a12);
        let b = (a13 * b12 * w1 - a12 * b13 * w0 - 2.0 * w0 * w1 * (a12 - a13)) * a;
        let c = ((a13 - a12) * w0 * w0 + a13 * b12 * w0 + a13) * a;
        for (k, tau) in quadratic(b, c).into_iter().enumerate() {
            let d = a23 / (tau * (b23 + tau) + 1.0);
            if !(tau > 0.0 && d > 0.0) {
                continue;
            }
            let l2 = d.sqrt();
            let l3 = tau * l2;
            let l1 = w0 * l2 + w1 * l3;
            found[2 * slot + k] = (l1 > 0.0 && l1.is_finite()).then_some([l1, l2, l3]);
        }
    }
    found
}

/// A real root of the determinant of the pencil of conics, where its slope is largest.
fn cubic(a12: f64, a13: f64, a23: f64, b12: f64, b13: f64, b23: f64) -> Option<f64> {
    let (c12, c23, c31) = (-0.5 * b12, -0.5 * b23, -0.5 * b13);
    let blob = c12 * c23 * c31 - 1.0;
    let (s31, s23, s12) = (1.0 - c31 * c31, 1.0 - c23 * c23, 1.0 - c12 * c12);
    let p3 = a13 * (a23 * s31 - a13 * s23);
    let p2 = 2.0 * blob * a23 * a13 + a13 * (2.0 * a12 + a13) * s23 + a23 * (a23 - a12) * s31;
    let p1 = a23 * (a13 - a23) * s12 - a12 * a12 * s23 - 2.0 * a12 * (blob * a23 + a13 * s23);
    let p0 = a12 * (a12 * s23 - a23 * s12);
    let (b, c, d) = (p2 / p3, p1 / p3, p0 / p3);
    if !(b.is_finite() && c.is_finite() && d.is_finite()) {
        return None;
    }
    // Depressed cubic t³ + pt + q of t = g + b/3; the root by Cardano or Viète, then Newton's steps.
    let (p, q) = (c - b * b / 3.0, b * (2.0 * b * b / 27.0 - c / 3.0) + d);
    let discriminant = 0.25 * q * q + p * p * p / 27.0;
    let t = if discriminant >= 0.0 {
        let root = discriminant.sqrt();
        (-0.5 * q + root).cbrt() + (-0.5 * q - root).cbrt()
    } else {
        let radius = 2.0 * (-p / 3.0).sqrt();
        let angle = (3.0 * q / (p * radius)).clamp(-1.0, 1.0).acos() / 3.0;
        radius * angle.cos()
    };
    let mut g = t - b / 3.0;
    for _ in 0..4 {
        let (value, slope) = (((g + b) * g + c) * g + d, (3.0 * g + 2.0 * b) * g + c);
        let step = value / slope;
        if step.is_finite() {
            g -= step;
        }
    }
    g.is_finite().then_some(g)
}

/// The two nonzero eigenvalues of a singular symmetric matrix, the one of larger magnitude first, and their
/// eigenvectors.
fn eigen_known_zero(m: &[[f64; 3]; 3]) -> Option<([f64; 2], [DVec3; 2])> {
    let trace = m[0][0] + m[1][1] + m[2][2];
    let minors = m[0][0] * m[1][1] - m[0][1] * m[0][1] + m[0][0] * m[2][2] - m[0][2] * m[0][2]
        + m[1][1] * m[2][2]
        - m[1][2] * m[1][2];
    let [mut e1, mut e2] = quadratic_roots(-trace, minors)?;
    if e1.abs() < e2.abs() {
        (e1, e2) = (e2, e1);
    }
    Some(([e1, e2], [eigenvector(m, e1)?, eigenvector(m, e2)?]))
}

/// The null direction of a symmetric matrix less `value` on its diagonal: the largest cross product of its rows.
fn eigenvector(m: &[[f64; 3]; 3], value: f64) -> Option<DVec3> {
    let row = |i: usize| {
        let mut row = DVec3::from_array(m[i]);
        row[i] -= value;
        row
    };
    let products = [row(0).cross(row(1)), row(1).cross(row(2)), row(2).cross(row(0))];
    let largest = products.into_iter().max_by(|a, b| a.length().total_cmp(&b.length()))?;
    largest.try_normalize()
}

/// Real roots of x² + bx + c; of none, the list is empty.
fn quadratic(b: f64, c: f64) -> impl IntoIterator<Item = f64> {
    quadratic_roots(b, c).into_iter().flatten()
}

fn quadratic_roots(b: f64, c: f64) -> Option<[f64; 2]> {
    let discriminant = b * b - 4.0 * c;
    if !(discriminant >= 0.0) {
        return None;
    }
    // The one of larger magnitude first: nothing cancels.
    let first = -0.5 * (b + b.signum() * discriminant.sqrt());
    Some([first, if first == 0.0 { 0.0 } else { c / first }])
}

/// The rigid motion from three points to three others with the same distances between them.
fn motion(from: [DVec3; 3], to: [DVec3; 3]) -> Option<Pose> {
    let frame = |[a, b, c]: [DVec3; 3]| {
        let x = (b - a).try_normalize()?;
        let z = x.cross(c - a).try_normalize()?;
        Some(DMat3::from_cols(x, z.cross(x), z))
    };
    let rotation = DQuat::from_mat3(&(frame(to)? * frame(from)?.transpose())).normalize();
    let pose = Pose { rotation, translation: to[0] - rotation * from[0] };
    pose.is_finite().then_some(pose)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn the_true_pose_is_among_them() {
        let mut random = Random::new(3);
        let mut next = || random.even();
        let mut missed = 0;
        for _ in 0..2000 {
            let step = std::array::from_fn(|i| next() * if i < 3 { 3.0 } else { 1.7 });
            let truth = Pose::exp(&step);
            let seen: [DVec3; 3] =
                std::array::from_fn(|_| DVec3::new(next(), next(), 3.0 + 2.0 * next()));
            let world = seen.map(|p| truth.inverse().rotation * p + truth.inverse().translation);
            let near = |pose: &Pose| {
                pose.angle_to(&truth) < 1e-4 && (pose.centre() - truth.centre()).length() < 1e-3
            };
            missed += usize::from(!poses(seen, world).iter().flatten().any(near));
        }
        // Nearly degenerate triples lose digits.
        assert!(missed <= 4, "{missed} of 2000");
    }

    #[test]
    fn degenerate_points_give_no_pose_that_is_not_finite() {
        let rays = [DVec3::Z, DVec3::new(0.1, 0.0, 1.0), DVec3::new(0.2, 0.0, 1.0)];
        for points in [
            [DVec3::ZERO; 3],
            [DVec3::X, DVec3::X * 2.0, DVec3::X * 3.0],
            [DVec3::X, DVec3::X, DVec3::Y],
            [DVec3::NAN, DVec3::X, DVec3::Y],
        ] {
            assert!(poses(rays, points).iter().flatten().all(Pose::is_finite));
        }
    }
}
