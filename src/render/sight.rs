//! What cameras near a pose can see: which blocks of a blocked prior a picture needs.

use glam::{DMat3, DVec3};

use crate::prior::blocked::Block;
use crate::shared::{EXTENT_MAX, frustum};
use crate::{Camera, Pose, RenderOptions};

/// How far from a pose a camera may be.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Reach {
    /// Distance of the centres, the prior's unit.
    pub moved: f64,
    /// The chord `2 sin(a/2)` of a turn by the angle a.
    pub turned: f64,
}

impl Reach {
    /// At the pose itself.
    pub const NONE: Reach = Reach { moved: 0.0, turned: 0.0 };

    /// Whether all that this reach allows is within another.
    pub fn within(&self, other: &Reach) -> bool {
        self.moved <= other.moved && self.turned <= other.turned
    }

    /// The greater of both, each.
    pub fn or(&self, other: &Reach) -> Reach {
        Reach { moved: self.moved.max(other.moved), turned: self.turned.max(other.turned) }
    }

    /// Both, so many times as far.
    pub fn times(&self, factor: f64) -> Reach {
        Reach { moved: factor * self.moved, turned: factor * self.turned }
    }
}

/// Widening of the picture by which rounding on the device changes nothing, pixels.
const ROUNDING: f64 = 1.0;

/// A camera at a pose or within its reach. Tests for blocks are conservative: a block that is not seen shows nothing.
///
/// A splat with standard deviations up to σ, at (x, y, z) of the camera, is drawn within `EXTENT_MAX · (f/z · √(1 + t²)
/// · σ + √low-pass)` pixels around its mean `c + f x/z`: `J Σ Jᵀ ≤ (f/z)² (1 + t²) σ²`, with the ray's slope t limited
/// to the frustum and its margin. So it shows nothing in a picture of W pixels if `x − z (W − c + EXTENT_MAX
/// √low-pass)/f > EXTENT_MAX √(1 + t²) σ`, and the same on the other sides. That is linear in the splat's place, and
/// the least value over a box is known.
pub(crate) struct Sight {
    rotation: DMat3,
    centre: DVec3,
    reach: Reach,
    near: f64,
    /// For each side of the picture: a direction in camera axes, outwards.
    sides: [DVec3; 4],
    /// By how many σ a splat may lie beyond a side.
    sigmas: [f64; 4],
}

impl Sight {
    /// What some cameras, levels of one picture, can see from a pose within a reach.
    pub fn new(
        cameras: impl Iterator<Item = Camera>,
        options: &RenderOptions,
        pose: &Pose,
        reach: Reach,
    ) -> Sight {
        // Slopes of the picture's sides, widened: left, right, upper, lower.
        let mut slopes = [0.0_f64; 4];
        let mut rays = [0.0_f64; 4];
        for camera in cameras {
            let sides =
                [(camera.width, camera.fx, camera.cx), (camera.height, camera.fy, camera.cy)];
            for (axis, (length, focal, principal)) in sides.into_iter().enumerate() {
                let [low_pass, _] = options.low_pass(&camera, 1).map(f64::from);
                let blur = f64::from(EXTENT_MAX) * low_pass.sqrt() + ROUNDING;
                let (f, c) = (f64::from(focal), f64::from(principal));
                let limits = frustum(length, focal, principal).map(|v| f64::from(v).abs());
                let ray = limits[0].max(limits[1]);
                let [low, high] = [(c + blur) / f, (f64::from(length) - c + blur) / f];
                for (side, slope) in [(2 * axis, low), (2 * axis + 1, high)] {
                    slopes[side] = slopes[side].max(slope);
                    rays[side] = rays[side].max(ray);
                }
            }
        }
        let side = |axis: usize, sign: f64, slope: f64| {
            let mut direction = DVec3::new(0.0, 0.0, -slope);
            direction[axis] = sign;
            direction
        };
        Sight {
            rotation: pose.matrix(),
            centre: pose.centre(),
            reach,
            near: options.near.into(),
            sides: [
                side(0, -1.0, slopes[0]),
                side(0, 1.0, slopes[1]),
                side(1, -1.0, slopes[2]),
                side(1, 1.0, slopes[3]),
            ],
            sigmas: rays.map(|ray| f64::from(EXTENT_MAX) * (1.0 + ray * ray).sqrt()),
        }
    }

    /// Whether a picture may show something of a block. If the pose is not finite, it shows nothing.
    pub fn may_show(&self, block: &Block) -> bool {
        if !self.centre.is_finite() {
            return false;
        }
        let [least, greatest] =
            [block.least, block.greatest].map(|v| DVec3::from(v.map(f64::from)));
        let half = 0.5 * (greatest - least);
        let middle = self.rotation * (least + half - self.centre);
        let farthest = middle.length() + half.length();
        // A turn moves a point by its chord; rounding on the device by far less than a millionth.
        let off =
            self.reach.moved + (self.reach.turned + 1e-6) * farthest + 1e-6 * self.centre.length();
        // The box's half extent along a direction of the camera.
        let extent = |direction: DVec3| {
            let in_world = self.rotation.transpose() * direction;
            in_world.abs().dot(half)
        };
        if middle.z + extent(DVec3::Z) + off <= self.near {
            return false;
        }
        let beyond = |(side, sigmas): (&DVec3, &f64)| {
            let nearest = side.dot(middle) - extent(*side) - off * side.length();
            nearest > sigmas * f64::from(block.longest)
        };
        !self.sides.iter().zip(&self.sigmas).any(beyond)
    }
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;
    use crate::random::Random;

    const CAMERA: Camera =
        Camera { width: 320, height: 180, fx: 270.0, fy: 270.0, cx: 160.0, cy: 90.0 };

    fn block(middle: [f32; 3], half: f32, longest: f32) -> Block {
        let [least, greatest] = [-half, half].map(|by| middle.map(|v| v + by));
        Block { splats: 1, least, greatest, longest, bytes: 1, check: 0, offset: 0 }
    }

    fn sees(reach: Reach, block: &Block) -> bool {
        Sight::new([CAMERA].into_iter(), &RenderOptions::INRIA, &Pose::IDENTITY, reach)
            .may_show(block)
    }

    #[test]
    fn blocks_in_front_are_seen_and_others_are_not() {
        assert!(sees(Reach::NONE, &block([0.0, 0.0, 5.0], 0.1, 0.01)));
        assert!(!sees(Reach::NONE, &block([0.0, 0.0, -5.0], 0.1, 0.01)));
        // The picture's right side is at a slope of 160/270.
        assert!(sees(Reach::NONE, &block([2.9, 0.0, 5.0], 0.01, 0.01)));
        assert!(!sees(Reach::NONE, &block([3.3, 0.0, 5.0], 0.01, 0.01)));
        assert!(sees(Reach::NONE, &block([3.3, 0.0, 5.0], 0.5, 0.01)), "a larger box");
        assert!(sees(Reach::NONE, &block([3.3, 0.0, 5.0], 0.01, 0.5)), "a longer splat");
        assert!(sees(Reach { moved: 0.4, turned: 0.0 }, &block([3.3, 0.0, 5.0], 0.01, 0.01)));
        assert!(sees(Reach { moved: 0.0, turned: 0.1 }, &block([3.3, 0.0, 5.0], 0.01, 0.01)));
    }

    /// Whatever a camera within reach sees of a point splat, its block is seen from the pose.
    #[test]
    fn nothing_within_reach_is_left_out() {
        let mut random = Random::new(7);
        let mut seen = 0;
        for _ in 0..20_000 {
            let mut within = |most: f32| f64::from(random.within(-most, most));
            let pose = Pose::from_centre(
                DQuat::from_xyzw(within(1.0), within(1.0), within(1.0), 1.0).normalize(),
                DVec3::new(within(3.0), within(3.0), within(3.0)),
            );
            let reach = Reach { moved: within(1.0).abs(), turned: within(0.5).abs() };
            let turn = DVec3::new(within(1.0), within(1.0), within(1.0)).normalize_or_zero();
            let turn = DQuat::from_scaled_axis(turn * reach.turned.min(1.9));
            let by = DVec3::new(within(1.0), within(1.0), within(1.0)).normalize_or_zero();
            let other = Pose::from_centre(turn * pose.rotation, pose.centre() + by * reach.moved);
            let point = DVec3::new(within(8.0), within(8.0), within(8.0));
            let p = other.rotation * point + other.translation;
            let pixel = [p.x / p.z * 270.0 + 160.0, p.y / p.z * 270.0 + 90.0];
            let inside =
                p.z > 0.2 && (0.0..320.0).contains(&pixel[0]) && (0.0..180.0).contains(&pixel[1]);
            if inside {
                seen += 1;
                let sight = Sight::new([CAMERA].into_iter(), &RenderOptions::INRIA, &pose, reach);
                let block = block(point.to_array().map(|v| v as f32), 0.0, 1e-6);
                assert!(sight.may_show(&block), "{point} from {pose:?} by {reach:?}");
            }
        }
        assert!(seen > 500, "{seen}");
    }
}
