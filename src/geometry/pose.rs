//! Camera poses: world-to-camera rigid motions.

use glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};

/// A world-to-camera rigid motion, `X_c = R X_w + t`. Lengths in the prior's own unit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// Unit quaternion of `R`.
    pub rotation: DQuat,
    /// `t`, in camera axes.
    pub translation: DVec3,
}

/// A pose step `τ = (ρ, θ)`: translation then rotation vector (radians), applied from the left.
pub type Twist = [f64; 6];

/// The rotation of a matrix; `None` if it is none. `within`: how far its product with its transpose may be from the
/// identity, by each number.
pub fn rotation_of(matrix: &DMat3, within: f64) -> Option<DQuat> {
    let off = (*matrix * matrix.transpose() - DMat3::IDENTITY).to_cols_array();
    let is_rotation = off.iter().all(|v| v.abs() < within) && matrix.determinant() > 0.0;
    is_rotation.then(|| DQuat::from_mat3(matrix).normalize())
}

impl Default for Pose {
    fn default() -> Pose {
        Pose::IDENTITY
    }
}

impl Pose {
    /// The pose whose camera stands at the world's origin and looks along +z.
    pub const IDENTITY: Pose = Pose { rotation: DQuat::IDENTITY, translation: DVec3::ZERO };

    /// Takes `q = (w, x, y, z)` of any length but zero, and `t`. `None` if that is no pose.
    pub fn from_wxyz(q: [f64; 4], t: [f64; 3]) -> Option<Pose> {
        let rotation = DQuat::from_xyzw(q[1], q[2], q[3], q[0]);
        let length = rotation.length();
        let finite = length.is_finite() && t.iter().all(|v| v.is_finite());
        (finite && length > 1e-6)
            .then(|| Pose { rotation: rotation * (1.0 / length), translation: DVec3::from(t) })
    }

    /// The quaternion as (w, x, y, z).
    pub fn wxyz(&self) -> [f64; 4] {
        let q = self.rotation;
        [q.w, q.x, q.y, q.z]
    }

    /// Whether every component is a finite number.
    pub fn is_finite(&self) -> bool {
        self.rotation.is_finite() && self.translation.is_finite()
    }

    /// `R` as a matrix.
    pub fn matrix(&self) -> DMat3 {
        DMat3::from_quat(self.rotation)
    }

    /// The camera's position in the world, `−Rᵀ t`.
    pub fn centre(&self) -> DVec3 {
        self.rotation.conjugate() * -self.translation
    }

    /// The pose with rotation `R` whose camera stands at `centre`.
    pub fn from_centre(rotation: DQuat, centre: DVec3) -> Pose {
        Pose { rotation, translation: rotation * -centre }
    }

    /// The pose of points whose coordinates count from `origin`.
    pub fn relative_to(&self, origin: DVec3) -> Pose {
        Pose { translation: self.translation + self.rotation * origin, ..*self }
    }

    /// Undoes [`relative_to`](Self::relative_to).
    pub fn absolute_from(&self, origin: DVec3) -> Pose {
        self.relative_to(-origin)
    }

    /// `Exp(τ) ∘ self`, the left perturbation `dp_c = ρ + θ × p_c`.
    pub fn stepped(&self, tau: &Twist) -> Pose {
        Pose::exp(tau).after(self)
    }

    /// `self ∘ first`: apply `first`, then `self`.
    pub fn after(&self, first: &Pose) -> Pose {
        Pose {
            rotation: (self.rotation * first.rotation).normalize(),
            translation: self.rotation * first.translation + self.translation,
        }
    }

    /// The inverse motion.
    pub fn inverse(&self) -> Pose {
        let rotation = self.rotation.conjugate();
        Pose { rotation, translation: rotation * -self.translation }
    }

    /// The exponential map of SE(3) (Barfoot, State Estimation for Robotics, eq. 8.30–8.33).
    pub fn exp(tau: &Twist) -> Pose {
        let rho = DVec3::new(tau[0], tau[1], tau[2]);
        let theta = DVec3::new(tau[3], tau[4], tau[5]);
        let angle2 = theta.length_squared();
        let angle = angle2.sqrt();
        // (1 − cos a)/a² and (a − sin a)/a³; by series if the quotients would lose digits.
        let (b, c) = if angle < 1e-4 {
            (0.5 - angle2 / 24.0, 1.0 / 6.0 - angle2 / 120.0)
        } else {
            ((1.0 - angle.cos()) / angle2, (angle - angle.sin()) / (angle2 * angle))
        };
        let cross = theta.cross(rho);
        Pose {
            rotation: DQuat::from_scaled_axis(theta),
            translation: rho + b * cross + c * theta.cross(cross),
        }
    }

    /// The step whose [`exp`](Self::exp) is this motion; it turns by at most π (Barfoot, eq. 8.33).
    pub fn log(&self) -> Twist {
        let q = if self.rotation.w < 0.0 { -self.rotation } else { self.rotation };
        let sine = q.xyz().length();
        let angle = 2.0 * sine.atan2(q.w);
        let theta = q.xyz() * if sine < 1e-9 { 2.0 } else { angle / sine };
        let angle2 = angle * angle;
        // 1/a² − (1 + cos a)/(2 a sin a); by series if that would lose digits.
        let d = if angle < 1e-2 {
            1.0 / 12.0 + angle2 / 720.0 + angle2 * angle2 / 30_240.0
        } else {
            (1.0 - 0.5 * angle / (0.5 * angle).tan()) / angle2
        };
        let cross = theta.cross(self.translation);
        let rho = self.translation - 0.5 * cross + d * theta.cross(cross);
        [rho.x, rho.y, rho.z, theta.x, theta.y, theta.z]
    }

    /// The pose that constant velocity predicts after the poses `before` and `self`: repeats the
    /// motion between them.
    pub fn predicted(&self, before: &Pose) -> Pose {
        self.after(&before.inverse()).after(self)
    }

    /// The pose on the way to another: 0 is this one, 1 the other. Each step of the way is the same motion; beyond 0 to
    /// 1 it goes on.
    pub fn between(&self, other: &Pose, part: f64) -> Pose {
        let way = other.after(&self.inverse()).log();
        self.stepped(&way.map(|value| part * value))
    }

    /// Angle between the two rotations, radians.
    pub fn angle_to(&self, other: &Pose) -> f64 {
        let relative = self.rotation * other.rotation.conjugate();
        2.0 * relative.xyz().length().atan2(relative.w.abs())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: &Pose, b: &Pose) -> bool {
        a.angle_to(b) < 1e-12 && (a.translation - b.translation).length() < 1e-12
    }

    #[test]
    fn half_the_way_twice_is_the_way() {
        let from = Pose::exp(&[1.0, -2.0, 0.5, 0.3, 0.1, -0.4]);
        let to = Pose::exp(&[1.5, -1.0, 0.0, -0.2, 0.6, 0.1]);
        let step = |a: &Pose, b: &Pose| b.after(&a.inverse()).log();
        let half = from.between(&to, 0.5);
        for (a, b) in std::iter::zip(step(&from, &half), step(&half, &to)) {
            assert!((a - b).abs() < 1e-12, "{a} {b}");
        }
        let end = from.between(&to, 1.0);
        assert!(step(&end, &to).iter().all(|value| value.abs() < 1e-12));
    }

    #[test]
    fn exp_is_a_one_parameter_group() {
        let tau = [0.3, -0.2, 0.5, 0.7, -1.1, 0.4];
        let half = tau.map(|v| v / 2.0);
        let twice = Pose::exp(&half).after(&Pose::exp(&half));
        assert!(close(&twice, &Pose::exp(&tau)));
        assert!(close(&Pose::exp(&tau).after(&Pose::exp(&tau.map(|v| -v))), &Pose::IDENTITY));
    }

    #[test]
    fn log_undoes_exp() {
        for size in [0.0, 1e-9, 1e-4, 0.0099, 0.0101, 0.5, 2.0] {
            let tau = [0.3, -0.2, 0.5, 0.7, -1.1, 0.4].map(|v| v * size);
            let found = Pose::exp(&tau).log();
            assert!(tau.iter().zip(found).all(|(a, b)| (a - b).abs() < 1e-11), "{tau:?} {found:?}");
        }
    }

    #[test]
    fn small_steps_move_points_as_the_convention_says() {
        let tau = [1e-7, 2e-7, -1e-7, 3e-7, -2e-7, 1e-7];
        let pose = Pose::from_wxyz([0.9, 0.1, -0.3, 0.2], [1.0, 2.0, 3.0]).unwrap();
        let p = pose.rotation * DVec3::new(0.4, -0.7, 2.0) + pose.translation;
        let stepped = pose.stepped(&tau);
        let moved = stepped.rotation * DVec3::new(0.4, -0.7, 2.0) + stepped.translation;
        let expected = DVec3::new(1e-7, 2e-7, -1e-7) + DVec3::new(3e-7, -2e-7, 1e-7).cross(p);
        assert!((moved - p - expected).length() < 1e-12);
    }

    #[test]
    fn centre_round_trips() {
        let pose = Pose::from_wxyz([0.9, 0.1, -0.3, 0.2], [1.0, 2.0, 3.0]).unwrap();
        assert!(close(&Pose::from_centre(pose.rotation, pose.centre()), &pose));
    }

    #[test]
    fn prediction_repeats_the_last_motion() {
        let before = Pose::from_wxyz([0.9, 0.1, -0.3, 0.2], [1.0, 2.0, 3.0]).unwrap();
        let tau = [0.1, 0.0, -0.2, 0.02, 0.01, -0.03];
        let now = before.stepped(&tau);
        assert!(close(&now.predicted(&before), &now.stepped(&tau)));
    }

    #[test]
    fn refuses_what_is_no_pose() {
        assert!(Pose::from_wxyz([0.0; 4], [0.0; 3]).is_none());
        assert!(Pose::from_wxyz([f64::NAN, 0.0, 0.0, 1.0], [0.0; 3]).is_none());
        assert!(Pose::from_wxyz([1.0, 0.0, 0.0, 0.0], [f64::INFINITY, 0.0, 0.0]).is_none());
    }
}
