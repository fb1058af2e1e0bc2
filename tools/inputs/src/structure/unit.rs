//! The unit of lengths: COLMAP's is arbitrary, and a prior's near plane and its search for poses are not.

use glam::DVec3;

use crate::points::Point;
use crate::posed::{PosedInput, PosedPictures};

/// Median depth of the scene's points after scaling. The default near plane, 0.2, then lies at a twentieth of it.
pub const DEPTH: f64 = 4.0;

/// Cameras that are looked through, at most.
const CAMERAS: usize = 200;
/// Points that are looked at, at most.
const POINTS: usize = 20_000;

/// The same scene in the unit of [`DEPTH`], and what lengths were multiplied by. Without points it stays as it is.
pub fn scaled(mut posed: PosedPictures) -> (PosedPictures, f64) {
    let points = posed.points.as_deref().unwrap_or_default();
    let Some(depth) = depth(&posed.inputs, points) else { return (posed, 1.0) };
    let scale = DEPTH / depth;
    for input in &mut posed.inputs {
        input.pose.translation *= scale;
    }
    for point in posed.points.iter_mut().flatten() {
        point.position *= scale;
    }
    (posed, scale)
}

/// The median over cameras of the median depth of the points that they see.
fn depth(inputs: &[PosedInput], points: &[Point]) -> Option<f64> {
    let some = points.iter().step_by(points.len().div_ceil(POINTS).max(1));
    let positions: Vec<DVec3> = some.map(|point| point.position).collect();
    let inputs = inputs.iter().step_by(inputs.len().div_ceil(CAMERAS).max(1));
    median(inputs.filter_map(|input| median(depths(input, &positions).collect())).collect())
}

/// Depths of the points that lie in a picture. The lens's distortion is left out.
fn depths<'a>(input: &'a PosedInput, points: &'a [DVec3]) -> impl Iterator<Item = f64> + 'a {
    let lens = input.lens.intrinsics();
    points.iter().filter_map(move |point| {
        let DVec3 { x, y, z } = input.pose.rotation * *point + input.pose.translation;
        let (u, v) = (lens.fx * x / z + lens.cx, lens.fy * y / z + lens.cy);
        let within =
            (0.0..f64::from(lens.width)).contains(&u) && (0.0..f64::from(lens.height)).contains(&v);
        (z > 0.0 && within).then_some(z)
    })
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().filter(|value| *value > 0.0 && value.is_finite())
}

#[cfg(test)]
mod tests {
    use nvsprior::Pose;

    use super::*;
    use nvsprior::geometry::{Distortion, Intrinsics, Lens};

    fn input(z: f64) -> PosedInput {
        let intrinsics =
            Intrinsics { width: 40, height: 30, fx: 30.0, fy: 30.0, cx: 20.0, cy: 15.0 };
        PosedInput {
            name: "a.png".into(),
            file: "a.png".into(),
            lens: Lens::new(intrinsics, Distortion::None).unwrap(),
            pose: Pose { translation: DVec3::new(0.0, 0.0, z), ..Pose::IDENTITY },
            split: None,
            mask: None,
        }
    }

    fn point(position: DVec3) -> Point {
        Point { position, rgb: None, error: None, track: None }
    }

    #[test]
    fn the_median_point_comes_to_the_fixed_depth() {
        // Behind the camera and beside the picture nothing counts.
        let points = [0.01, 0.02, 0.03, -7.0].map(|z| point(DVec3::new(0.0, 0.0, z)));
        let beside = point(DVec3::new(100.0, 0.0, 1.0));
        let points = points.into_iter().chain([beside; 9]).collect();
        let posed = PosedPictures { inputs: vec![input(0.0); 3], points: Some(points) };
        let (posed, scale) = scaled(posed);
        assert!((scale - 200.0).abs() < 1e-9, "{scale}");
        assert!((posed.points.unwrap()[1].position.z - DEPTH).abs() < 1e-9);
        let posed = PosedPictures { inputs: vec![input(1.0)], points: Some(vec![point(DVec3::Z)]) };
        let (posed, scale) = scaled(posed);
        assert_eq!((posed.inputs[0].pose.translation.z, scale), (2.0, 2.0));
    }

    #[test]
    fn without_points_nothing_is_scaled() {
        for points in [None, Some(Vec::new()), Some(vec![point(-DVec3::Z)])] {
            let posed = PosedPictures { inputs: vec![input(0.0)], points };
            assert_eq!(scaled(posed).1, 1.0);
        }
    }
}
