//! The prior from above, drawn once: the map that the vehicle is shown on.

use anyhow::Context;
use glam::{DMat3, DQuat, DVec3};
use nvsprior::render::Plan;
use nvsprior::{Camera, Engine, Picture, Pose, Prior};

use super::projection::{self, Pixel};

/// Longer side of the picture, pixels.
const SIDE: f64 = 640.0;
/// Part of the splats that may lie outside of it, on each side.
const OUTSIDE: f64 = 0.01;
/// Opacity from which on a splat says how far the scene reaches.
const OPAQUE: f64 = 0.3;
/// How many times as far away as the scene is wide the camera stands: all is seen from straight above.
const FAR: f64 = 12.0;
/// Level part of a direction, from which on it is a heading.
const LEVEL: f64 = 0.1;

/// Which way is up. The mapping run's cameras were held level: so it is the direction that is square to all their x
/// axes, and against the mean of their y axes, which point down. A prior without key frames is drawn along its thinnest
/// axis.
pub fn up(prior: &Prior) -> DVec3 {
    let poses = prior.key_frames().poses();
    let axes = |axis: DVec3| poses.iter().map(move |pose| pose.rotation.inverse() * axis);
    let down: DVec3 = axes(DVec3::Y).sum();
    if down.length() > 0.2 * poses.len().max(1) as f64 {
        return level_up(axes(DVec3::X), -down.normalize());
    }
    let extent = |axis: usize| {
        let [low, high] = range(prior, |point| point[axis]);
        high - low
    };
    let thinnest = (0..3).min_by(|a, b| extent(*a).total_cmp(&extent(*b))).unwrap_or(1);
    // A camera's y axis points down.
    -DVec3::from_array(std::array::from_fn(|axis| f64::from(axis == thinnest)))
}

/// The direction near `about` that is most square to some unit vectors: the eigenvector of least eigenvalue of the sum
/// of their squares, by power iteration.
fn level_up(vectors: impl Iterator<Item = DVec3>, about: DVec3) -> DVec3 {
    let square = |v: DVec3| DMat3::from_cols(v * v.x, v * v.y, v * v.z);
    let rest = vectors.fold(DMat3::ZERO, |sum, v| sum + DMat3::IDENTITY - square(v));
    let step = |up: DVec3, _| (rest * up).try_normalize().unwrap_or(up);
    (0..200).fold(about, step)
}

/// The least and the greatest of a number that each splat has. A few strays do not count.
fn range(prior: &Prior, number: impl Fn(DVec3) -> f64) -> [f64; 2] {
    let splats = prior.splats();
    let opaque = (0..splats.len()).filter(|index| splats.opacity(*index) > OPAQUE);
    let mut numbers: Vec<f64> =
        opaque.map(|index| number(DVec3::from(splats.positions[index].map(f64::from)))).collect();
    numbers.extend(prior.key_frames().poses().iter().map(|pose| number(pose.centre())));
    if numbers.is_empty() {
        numbers.extend(splats.positions.iter().map(|at| number(DVec3::from(at.map(f64::from)))));
    }
    numbers.sort_by(f64::total_cmp);
    let last = numbers.len() - 1;
    let outside = (OUTSIDE * last as f64) as usize;
    [numbers[outside], numbers[last - outside]]
}

pub struct PlanView {
    camera: Camera,
    pose: Pose,
    /// Of the ground.
    pub pixels_per_unit: f64,
    pub picture: Picture,
}

impl PlanView {
    /// Draws it. What lies above the cameras of the mapping run is left out: it would hide the rest.
    pub fn draw(engine: &Engine, prior: &Prior, up: DVec3) -> anyhow::Result<PlanView> {
        let (camera, pose, pixels_per_unit) = viewpoint(prior, up);
        let [_, top] = range(prior, |point| point.dot(up));
        let centres = prior.key_frames().poses().iter().map(|pose| pose.centre().dot(up));
        let ceiling = centres.reduce(f64::max).unwrap_or(top);
        let splats = prior.splats();
        let below = |at: &[f32; 3]| DVec3::from(at.map(f64::from)).dot(up) <= ceiling;
        let kept: Vec<bool> = splats.positions.iter().map(below).collect();
        let mut picture = Picture::new(camera.width, camera.height);
        if kept.iter().any(|kept| *kept) {
            let part = Prior::from_splats(splats.filtered(&kept), *prior.options())?;
            let scene = engine.upload(&part).context("uploading the prior for its plan view")?;
            let mut renderer = engine.renderer(&scene, &camera, Plan::picture())?;
            renderer.picture(&pose, &mut picture)?;
        }
        let pose = pose.absolute_from(prior.origin());
        Ok(PlanView { camera, pose, pixels_per_unit, picture })
    }

    /// Which way a vehicle looks on it, degrees from its upper edge, clockwise. `None`: straight up or down.
    pub fn heading(&self, vehicle: &Pose) -> Option<f64> {
        let ahead = self.pose.rotation * (vehicle.rotation.inverse() * DVec3::Z);
        let is_level = ahead.truncate().length() > LEVEL;
        is_level.then(|| ahead.x.atan2(-ahead.y).to_degrees().rem_euclid(360.0))
    }

    /// Where a point of the scene lies on it.
    pub fn place(&self, point: DVec3) -> Option<Pixel> {
        projection::project(&self.camera, &self.pose, point, 0.0)
    }
}

/// A camera far above that has all of the scene in its picture, with the longer side across. And pixels of a unit of
/// the ground.
fn viewpoint(prior: &Prior, up: DVec3) -> (Camera, Pose, f64) {
    let any = if up.x.abs() < 0.9 { DVec3::X } else { DVec3::Y };
    let mut right = (any - up * any.dot(up)).normalize();
    let reach = |axis: DVec3| range(prior, move |point| point.dot(axis));
    let length = |[low, high]: [f64; 2]| high - low;
    let mut across = reach(right);
    // Forward is down; x, y and z of the camera are a right-handed system.
    let mut lower = (-up).cross(right);
    let mut down = reach(lower);
    if length(down) > length(across) {
        (right, lower) = (lower, -right);
        (across, down) = (down, [-across[1], -across[0]]);
    }
    let width = length(across).max(f64::MIN_POSITIVE) * 1.1;
    let height = (length(down) * 1.1).clamp(width * 0.3, width);
    let middle = |[low, high]: [f64; 2]| (low + high) / 2.0;
    let [ground, _] = reach(up);
    let centre = right * middle(across) + lower * middle(down) + up * (ground + FAR * width);
    let rows = DMat3::from_cols(right, lower, -up).transpose();
    let pose = Pose::from_centre(DQuat::from_mat3(&rows), centre);
    let [pixels, lines] = [SIDE, (SIDE * height / width).round()];
    let focal = (SIDE * FAR) as f32;
    let camera = Camera {
        width: pixels as u32,
        height: lines as u32,
        fx: focal,
        fy: focal,
        cx: (pixels / 2.0) as f32,
        cy: (lines / 2.0) as f32,
    };
    (camera, pose, SIDE / width)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, PI};

    use super::*;
    use nvsprior::RenderOptions;
    use nvsprior::prior::{KeyFrames, Splats};

    /// Splats on a floor of 8 by 4, along world x and z; y points down, as the key frames have it.
    fn floor() -> Prior {
        let mut splats = Splats { sh_degree: 0, ..Splats::default() };
        for k in 0..800 {
            let (x, z) = (f64::from(k % 40) * 0.2, f64::from(k / 40) * 0.2);
            splats.positions.push([x as f32, 1.0, z as f32]);
            splats.log_scales.push([-3.0; 3]);
            splats.rotations.push([1.0, 0.0, 0.0, 0.0]);
            splats.opacity_logits.push(3.0);
            splats.sh.extend([0.5; 3]);
        }
        let tilted = DQuat::from_rotation_x(0.3);
        let poses = vec![Pose::from_centre(tilted, DVec3::new(4.0, 0.0, 1.0))];
        let prior = Prior::from_splats(splats, RenderOptions::INRIA).unwrap();
        prior.with_key_frames(KeyFrames::new(poses).unwrap())
    }

    #[test]
    fn up_is_where_the_cameras_had_it() {
        let up = up(&floor());
        // The one key frame is tilted.
        assert!((up - DQuat::from_rotation_x(-0.3) * -DVec3::Y).length() < 1e-6, "{up}");
    }

    #[test]
    fn cameras_that_look_down_do_not_tilt_it() {
        // All pitched down, and more of them look one way than another.
        let turns = [0.0, 0.1, 0.2, 0.3, 1.5, 2.9_f64];
        let right = |turn: f64| DQuat::from_rotation_y(turn) * DVec3::X;
        let about = DVec3::new(0.3, -1.0, 0.4).normalize();
        let up = level_up(turns.into_iter().map(right), about);
        assert!((up + DVec3::Y).length() < 1e-6, "{up}");
        // Of cameras that all look one way, only the roll is known.
        let up = level_up([DVec3::X].into_iter(), about);
        assert!((up - DVec3::new(0.0, -1.0, 0.4).normalize()).length() < 1e-9, "{up}");
    }

    #[test]
    fn all_of_the_scene_is_on_it_with_the_longer_side_across() {
        let (camera, pose, pixels_per_unit) = viewpoint(&floor(), -DVec3::Y);
        assert_eq!(camera.width, SIDE as u32);
        assert!((300..=380).contains(&camera.height), "{}", camera.height);
        let seen = |x, z| {
            let point = DVec3::new(x, 1.0, z);
            projection::project(&camera, &pose, point, 0.0).unwrap().map(f64::from)
        };
        let [left, right] = [seen(0.0, 2.0), seen(7.8, 2.0)];
        assert!((right[0] - left[0]).abs() > 0.85 * SIDE && (right[1] - left[1]).abs() < 2.0);
        assert!(((right[0] - left[0]).abs() - 7.8 * pixels_per_unit).abs() < 2.0);
        for corner in [seen(0.0, 0.0), seen(7.8, 0.0), seen(0.0, 3.8), seen(7.8, 3.8)] {
            let inside = |value, side| (0.0..f64::from(side)).contains(&value);
            assert!(inside(corner[0], camera.width) && inside(corner[1], camera.height));
        }
        // It is no mirror image: seen from above, x to the right has z up.
        let [a, b] = [seen(1.0, 1.0), seen(1.0, 2.0)];
        let turned = (right[0] - left[0]) * (b[1] - a[1]);
        assert!(turned < 0.0, "{turned}");
        // A vehicle that goes along x heads to where x lies on it.
        let plan = PlanView { camera, pose, pixels_per_unit, picture: Picture::default() };
        let heading = |turn: f64| {
            let forth = DQuat::from_rotation_y(turn);
            plan.heading(&Pose::from_centre(forth, DVec3::ZERO)).unwrap()
        };
        let along_x = if right[0] > left[0] { 90.0 } else { 270.0 };
        assert!((heading(-FRAC_PI_2) - along_x).abs() < 1e-6, "{}", heading(-FRAC_PI_2));
        // Clockwise seen from above.
        let quarter = (heading(-PI) - along_x).rem_euclid(360.0);
        assert!((quarter - 90.0).abs() < 1e-6, "{quarter}");
        let down = Pose::from_centre(DQuat::from_rotation_x(FRAC_PI_2), DVec3::ZERO);
        assert_eq!(plan.heading(&down), None);
    }
}
