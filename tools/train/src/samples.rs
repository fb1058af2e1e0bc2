//! Sample views of a mission: its cameras' poses, and poses near them.

use glam::DVec3;

use nvsprior::random::Random;
use nvsprior::{Camera, Pose};

/// How far a mission's cameras may be from the poses that stand for them, in place and direction.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Margin {
    /// Greatest distance, the prior's unit.
    pub distance: f64,
    /// Greatest angle, radians.
    pub angle: f64,
}

impl Margin {
    pub fn is_none(&self) -> bool {
        !(self.distance > 0.0 || self.angle > 0.0)
    }

    /// A pose within the margin of `pose`. Each number `draw` gives another.
    pub fn near(&self, pose: &Pose, draw: u64) -> Pose {
        let rho = in_ball(3 * draw) * self.distance;
        let theta = in_ball(!(3 * draw)) * self.angle;
        // Turns about the camera's place, not the world's origin, so the turn moves no camera.
        pose.stepped(&[rho.x, rho.y, rho.z, theta.x, theta.y, theta.z])
    }

    /// Poses near each of `views` in turn, `count` in all, with the draws from number `first` on.
    pub fn around(
        &self,
        views: &[(Camera, Pose)],
        first: u64,
        count: usize,
    ) -> Vec<(Camera, Pose)> {
        let turns = std::iter::zip(views.iter().cycle(), first..).take(count);
        turns.map(|((camera, pose), draw)| (*camera, self.near(pose, draw))).collect()
    }
}

/// A uniform draw from the unit ball: the first point of a sequence in the cube that lies in the ball.
fn in_ball(seed: u64) -> DVec3 {
    let mut random = Random::new(seed.wrapping_mul(0xd134_2543_de82_ef95));
    loop {
        let point = DVec3::from_array(std::array::from_fn(|_| random.even()));
        if point.length_squared() <= 1.0 {
            return point;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn draws_stay_within_the_margin_and_fill_it() {
        let margin = Margin { distance: 0.5, angle: 0.2 };
        let pose = Pose::from_wxyz([0.9, 0.1, -0.3, 0.2], [1.0, 2.0, 3.0]).unwrap();
        let (mut far, mut turned) = (0.0_f64, 0.0_f64);
        for draw in 0..200 {
            let near = margin.near(&pose, draw);
            far = far.max((near.centre() - pose.centre()).length());
            turned = turned.max(near.angle_to(&pose));
            assert_eq!(near, margin.near(&pose, draw));
            assert_ne!(near, margin.near(&pose, draw + 1));
        }
        assert!((0.4..=0.5 + 1e-12).contains(&far), "{far}");
        assert!((0.16..=0.2 + 1e-12).contains(&turned), "{turned}");
        assert!(Margin::default().is_none() && !margin.is_none());
    }
}
