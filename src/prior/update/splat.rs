//! A new splat in steps, and as the numbers that it stands for.

use glam::DQuat;

use super::super::orientation;
use super::grid::UpdateGrid;
use super::limits::{COLOUR_STEP, LOG_SCALE_STEP, LOGIT_STEP, LOGITS, ROTATION_STEPS};

/// A splat that an update adds, in steps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct NewSplat {
    /// Steps of the grid, from its origin.
    pub position: [i32; 3],
    /// Natural logarithms of the standard deviations, in steps of [`LOG_SCALE_STEP`].
    pub log_scale: [i8; 3],
    /// x, y and z of the rotation, splat to world, −12 to 12 parts of 12. w is not negative and makes the length 1. If
    /// x, y and z alone are longer, w is 0 and they are shortened.
    pub rotation: [i8; 3],
    /// Logit of the opacity in steps of [`LOGIT_STEP`]: [`LOGITS`].
    pub opacity: i8,
    /// The constant coefficient of the spherical harmonics, RGB, in steps of [`COLOUR_STEP`].
    pub colour: [i8; 3],
}

/// A learnt splat: what a [`NewSplat`] stands for. Its other coefficients of the spherical harmonics are zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LearntSplat {
    /// The prior's unit, world axes.
    pub position: [f32; 3],
    /// Natural logarithms of the standard deviations along the splat's own axes.
    pub log_scale: [f32; 3],
    /// Unit quaternion (w, x, y, z), splat to world.
    pub rotation: [f32; 4],
    /// Logit of the opacity.
    pub logit: f32,
    /// The constant coefficient of the spherical harmonics, RGB.
    pub colour: [f32; 3],
}

#[cfg(feature = "training")]
impl LearntSplat {
    /// Its position.
    pub(crate) fn centre(&self) -> glam::DVec3 {
        self.position.map(f64::from).into()
    }
}

impl NewSplat {
    /// The splat in steps that looks most like one. Its axes are named so that the rotation is the smallest, since
    /// small rotations take the fewest bytes. Values out of range become the nearest ones in it; NaN becomes 0.
    pub fn nearest(splat: &LearntSplat, grid: &UpdateGrid) -> NewSplat {
        let scales = splat.log_scale.map(|s| i32::from(steps(s, LOG_SCALE_STEP)));
        let (scales, q) = orientation::renamed(scales, unit(splat.rotation));
        let rotation = turn_in_steps(without_idle_turn(scales, q));
        let log_scale = scales.map(|s| s as i8);
        NewSplat { log_scale, rotation, ..NewSplat::as_named(splat, grid) }
    }

    /// The same with its axes as they are named, and with turns that show nothing: to compare it with what it was
    /// before.
    pub(super) fn as_named(splat: &LearntSplat, grid: &UpdateGrid) -> NewSplat {
        let (least, most) = (*LOGITS.start(), *LOGITS.end());
        NewSplat {
            position: grid.steps(splat.position),
            log_scale: splat.log_scale.map(|s| steps(s, LOG_SCALE_STEP)),
            rotation: turn_in_steps(unit(splat.rotation)),
            opacity: steps(splat.logit, LOGIT_STEP).clamp(least, most),
            colour: splat.colour.map(|c| steps(c, COLOUR_STEP)),
        }
    }

    /// What it stands for, to the same bits on every machine.
    pub fn learnt(&self, grid: &UpdateGrid) -> LearntSplat {
        LearntSplat {
            position: grid.position(self.position),
            log_scale: self.log_scale.map(|s| f32::from(s) * LOG_SCALE_STEP),
            rotation: quaternion(self.rotation),
            logit: f32::from(self.opacity) * LOGIT_STEP,
            colour: self.colour.map(|c| f32::from(c) * COLOUR_STEP),
        }
    }

    /// Whether it is round, so that its rotation shows nothing.
    pub(super) fn is_round(&self) -> bool {
        let [a, b, c] = self.log_scale;
        a == b && b == c
    }

    /// What is wrong with it.
    pub(super) fn fault(&self) -> Option<String> {
        let (opacity, turn) = (self.opacity, self.rotation);
        if let Some(value) = turn.iter().find(|v| v.unsigned_abs() > ROTATION_STEPS as u8) {
            return Some(format!("rotation of {value} steps: at most ±{ROTATION_STEPS}"));
        }
        let (least, most) = (LOGITS.start(), LOGITS.end());
        let known = LOGITS.contains(&opacity);
        (!known).then(|| format!("opacity of {opacity} steps: {least} to {most}"))
    }
}

fn steps(value: f32, step: f32) -> i8 {
    f64::from(value / step).round() as i8
}

/// A quaternion made one of length 1; the one of no turn, if it has no length.
fn unit(rotation: [f32; 4]) -> DQuat {
    let [w, x, y, z] = rotation.map(f64::from);
    let q = DQuat::from_xyzw(x, y, z, w);
    let whole = q.length_squared() > 0.0 && q.is_finite();
    if whole { q.normalize() } else { DQuat::IDENTITY }
}

/// x, y and z of a unit quaternion, or of the opposite one, whose w is not negative.
fn turn_in_steps(q: DQuat) -> [i8; 3] {
    let sign = f64::from(ROTATION_STEPS).copysign(q.w);
    [q.x, q.y, q.z].map(|v| (sign * v).round() as i8)
}

/// The axis about which turns show nothing, because the other two scales are equal.
pub fn idle_axis(scales: [i32; 3]) -> Option<usize> {
    (0..3).find(|axis| scales[(axis + 1) % 3] == scales[(axis + 2) % 3])
}

/// A rotation without what shows nothing of it.
fn without_idle_turn(scales: [i32; 3], q: DQuat) -> DQuat {
    if scales[0] == scales[1] && scales[1] == scales[2] {
        return DQuat::IDENTITY;
    }
    let Some(axis) = idle_axis(scales) else { return q };
    let mut turn = DQuat::from_xyzw(0.0, 0.0, 0.0, q.w);
    match axis {
        0 => turn.x = q.x,
        1 => turn.y = q.y,
        _ => turn.z = q.z,
    }
    // The smallest of 24 rotations has a w of 0.85 or more, so the turn has a length.
    q * turn.normalize().conjugate()
}

/// The unit quaternion (w, x, y, z) of x, y, z in steps.
fn quaternion(steps: [i8; 3]) -> [f32; 4] {
    let whole = i32::from(ROTATION_STEPS).pow(2);
    let [x, y, z] = steps.map(i32::from);
    let square = x * x + y * y + z * z;
    let (w, length) = (f64::from((whole - square).max(0)), f64::from(square.max(whole)));
    [w.sqrt(), x.into(), y.into(), z.into()].map(|v| (v / length.sqrt()) as f32)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::super::fault::{MAX_COEFFICIENT, MAX_LOG_SCALE};
    use super::*;

    const GRID: UpdateGrid = UpdateGrid { origin: [1.0, 2.0, 3.0], exponent: -5 };

    #[test]
    fn any_steps_are_a_valid_splat() {
        for value in [i8::MIN, -1, 0, 1, i8::MAX] {
            let splat =
                NewSplat { log_scale: [value; 3], colour: [value; 3], ..Default::default() };
            let learnt = splat.learnt(&GRID);
            assert!(learnt.log_scale.iter().all(|s| s.abs() <= MAX_LOG_SCALE));
            assert!(learnt.colour.iter().all(|c| c.abs() <= MAX_COEFFICIENT));
        }
    }

    #[test]
    fn numbers_are_steps_times_their_size() {
        let splat = NewSplat {
            position: [32, -32, 0],
            log_scale: [-12, -11, 4],
            rotation: [6, 0, -6],
            opacity: 5,
            colour: [10, 0, -1],
        };
        let learnt = splat.learnt(&GRID);
        assert_eq!(learnt.position, [2.0, 1.0, 3.0]);
        assert_eq!(learnt.log_scale, [-3.0, -2.75, 1.0]);
        assert_eq!(learnt.rotation, [0.5_f32.sqrt(), 0.5, 0.0, -0.5]);
        assert_eq!(learnt.logit, 4.0);
        assert_eq!(learnt.colour, [10.0 * COLOUR_STEP, 0.0, -0.12]);
        let long = NewSplat { rotation: [12, 0, -5], ..splat }.learnt(&GRID);
        assert_eq!(long.rotation, [0.0, 12.0 / 13.0, 0.0, -5.0 / 13.0]);
    }

    #[test]
    fn values_out_of_range_become_the_nearest() {
        let splat = LearntSplat {
            position: [f32::NAN, 1e30, -1e30],
            log_scale: [99.0, -99.0, f32::NAN],
            rotation: [0.0; 4],
            logit: 20.0,
            colour: [f32::INFINITY, -f32::INFINITY, 0.0],
        };
        let near = NewSplat::nearest(&splat, &GRID);
        assert_eq!(near.position, [0, i32::MAX, i32::MIN]);
        assert_eq!(near.log_scale, [127, -128, 0]);
        assert_eq!((near.rotation, near.opacity), ([0; 3], 8));
        assert_eq!(near.colour, [127, -128, 0]);
        assert_eq!(near.fault(), None);
    }

    /// The covariance of a splat: how it looks, whatever its axes are called.
    fn covariance(rotation: [f32; 4], log_scale: [f32; 3]) -> [f64; 6] {
        let [w, x, y, z] = rotation.map(f64::from);
        let turn = glam::DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
        let scales = log_scale.map(|s| (2.0 * f64::from(s)).exp());
        let m = turn * glam::DMat3::from_diagonal(scales.into()) * turn.transpose();
        [m.x_axis.x, m.y_axis.y, m.z_axis.z, m.x_axis.y, m.x_axis.z, m.y_axis.z]
    }

    proptest! {
        #[test]
        fn the_nearest_splat_looks_alike(
            turn in proptest::array::uniform4(-1.0_f32..1.0),
            scale in proptest::array::uniform3(-4_i8..4),
            position in proptest::array::uniform3(-50.0_f32..50.0),
        ) {
            prop_assume!(turn.iter().map(|v| v * v).sum::<f32>() > 0.01);
            let splat = LearntSplat {
                position,
                log_scale: scale.map(|s| f32::from(s) * LOG_SCALE_STEP),
                rotation: turn,
                logit: 1.0,
                colour: [0.3, 0.5, 0.7],
            };
            let near = NewSplat::nearest(&splat, &GRID);
            prop_assert_eq!(near.fault(), None);
            prop_assert!(near.rotation.iter().all(|v| v.abs() <= 7), "{:?}", near);
            let found = near.learnt(&GRID);
            let near = |a: [f32; 3], b: [f32; 3], limit: f32| {
                a.iter().zip(b).all(|(a, b)| (a - b).abs() <= limit)
            };
            prop_assert!(near(found.position, position, 1.0 / 64.0 + 1e-5));
            prop_assert!(near(found.colour, splat.colour, 0.061));
            prop_assert!((found.logit - splat.logit).abs() <= 0.41);
            let (a, b) = (
                covariance(splat.rotation, splat.log_scale),
                covariance(found.rotation, found.log_scale),
            );
            // Half a step on three axes turns by 0.15 at most, and w follows.
            let largest = splat.log_scale.iter().fold(f32::MIN, |a, b| a.max(*b));
            let limit = 0.36 * (2.0 * f64::from(largest)).exp();
            prop_assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() <= limit), "{:?} {:?}", a, b);
        }
    }
}
