//! Poses and points on a grid. The programs that find poses sum in another order in each run: their results differ by
//! about 1e-11. On a grid far coarser than that, and far finer than what poses are known to, they come out the same.

use glam::DQuat;
use nvsprior::Pose;
use nvsprior::geometry::{Distortion, Intrinsics, Lens};

use crate::posed::PosedPictures;

/// Steps per unit: of a pose's place, in depths of the scene, and of its turn, radians.
const POSE: f64 = 1e6;
/// Steps per unit of a point's place. Splats only start there.
const POINT: f64 = 1024.0;
/// Steps per pixel of a lens, and per unit of its distortion.
const PIXEL: f64 = 1e4;
const DISTORTION: f64 = 1e6;

fn on_grid(value: f64, steps: f64) -> f64 {
    (value * steps).round() / steps
}

/// Brings all numbers to the grid.
pub fn round(posed: &mut PosedPictures) {
    for input in &mut posed.inputs {
        input.pose = pose(&input.pose);
        input.lens = lens(&input.lens);
    }
    for point in posed.points.iter_mut().flatten() {
        point.position = point.position.map(|value| on_grid(value, POINT));
        point.error = None;
    }
}

fn pose(pose: &Pose) -> Pose {
    let [x, y, z, w] = pose.rotation.to_array();
    // Of the two quaternions of a rotation one is taken.
    let sign = if w < 0.0 { -1.0 } else { 1.0 };
    let rounded = [x, y, z, w].map(|value| on_grid(sign * value, POSE));
    Pose {
        rotation: DQuat::from_array(rounded).normalize(),
        translation: pose.translation.map(|value| on_grid(value, POSE)),
    }
}

/// A lens of rounded numbers; as it is if they make none.
fn lens(lens: &Lens) -> Lens {
    let pixels = |value: f64| on_grid(value, PIXEL);
    let Intrinsics { width, height, fx, fy, cx, cy } = *lens.intrinsics();
    let intrinsics = Intrinsics {
        width,
        height,
        fx: pixels(fx),
        fy: pixels(fy),
        cx: pixels(cx),
        cy: pixels(cy),
    };
    let rounded = |value: f64| on_grid(value, DISTORTION);
    let distortion = match *lens.distortion() {
        Distortion::None => Distortion::None,
        Distortion::Brown(k) => Distortion::Brown(k.map(rounded)),
        Distortion::Fisheye(k) => Distortion::Fisheye(k.map(rounded)),
    };
    Lens::new(intrinsics, distortion).unwrap_or(*lens)
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use nvsprior::random::Random;

    #[test]
    fn what_differs_in_the_last_bits_comes_out_the_same() {
        let mut random = Random::new(4);
        let mut same = 0;
        for _ in 0..200 {
            let axis = DVec3::from(random.triple(-1.0, 1.0).map(f64::from));
            let translation = DVec3::from(random.triple(-9.0, 9.0).map(f64::from));
            let first = Pose { rotation: DQuat::from_scaled_axis(axis), translation };
            let second = Pose {
                rotation: -DQuat::from_scaled_axis(axis + 1e-11),
                translation: translation - 1e-11,
            };
            same += usize::from(pose(&first) == pose(&second));
            let off = pose(&first).rotation.angle_between(first.rotation);
            assert!(off < 3e-6, "{off}");
        }
        assert!(same >= 199, "{same}");
    }
}
