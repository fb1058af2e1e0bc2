//! A video of the quay, as a survey's camera records it: through a lens that distorts, on a course that a map can be
//! made from.

use glam::DVec2;
use nvsprior::Picture;
use nvsprior::geometry::{Distortion, Intrinsics, Lens, LensError};

use super::light::Light;
use super::sensor::{self, Disturbance};
use super::trace::{self, Rays};
pub use super::trajectory::quay::Filmed;
use super::{Conditions, DemoFrame, quay};

/// Seconds after which the course has come back to where it began; then it begins again.
pub const COURSE: f64 = super::trajectory::quay::SURVEY;

/// 1280 × 720 pixels, 80° wide, with barrel distortion; COLMAP's model OPENCV.
const INTRINSICS: Intrinsics =
    Intrinsics { width: 1280, height: 720, fx: 760.0, fy: 760.0, cx: 644.0, cy: 356.0 };
/// k1, k2, p1, p2.
const DISTORTION: [f64; 4] = [-0.12, 0.03, 0.0005, -0.0004];

/// The camera's lens.
pub fn survey_lens() -> Result<Lens, LensError> {
    Lens::new(INTRINSICS, Distortion::brown(&DISTORTION)?)
}

/// The frames of a video, each drawn when asked for. `rate`: frames per second.
pub fn survey(
    lens: &Lens,
    filmed: Filmed,
    frames: usize,
    rate: f64,
    conditions: Conditions,
) -> impl ExactSizeIterator<Item = DemoFrame> + use<> {
    // Tells their noise from that of the runs.
    let tag: u32 = match filmed {
        Filmed::Survey => 9,
        Filmed::Dive => 10,
    };
    let (scene, rays) = (quay::mapped(), Rays::of_lens(lens));
    (0..frames).map(move |index| {
        let time = index as f64 / rate;
        let pose = filmed.pose(time);
        let light = Light { time: time as f32, caustics: conditions.caustics };
        let radiance = trace::draw(&scene, &rays, &pose, &light);
        let disturbance = Disturbance { snow: conditions.snow, noise: conditions.noise };
        let seed = (tag << 24) | index as u32;
        let (width, height) = rays.size();
        let picture: Picture = sensor::expose(radiance, width, height, &disturbance, seed);
        DemoFrame { name: format!("{index:06}.png"), picture, pose, time }
    })
}

impl Rays {
    /// The rays of a lens. Where none reaches the picture there is none.
    fn of_lens(lens: &Lens) -> Rays {
        let (width, height) = lens.size();
        let through = |x: f32, y: f32| {
            let ray = lens.ray(DVec2::new(x.into(), y.into())).unwrap_or(DVec2::ZERO);
            ray.as_vec2()
        };
        Rays::new(width, height, lens.intrinsics().fx as f32, through)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CAMERA;

    #[test]
    fn the_lens_is_usable_and_distorts() {
        let lens = survey_lens().unwrap();
        lens.check_corners().unwrap();
        let corner = DVec2::new(0.0, 0.0);
        let pinhole = (corner - DVec2::new(INTRINSICS.cx, INTRINSICS.cy)) / INTRINSICS.fx;
        let ray = lens.ray(corner).unwrap();
        assert!(ray.length() > 1.05 * pinhole.length(), "{ray} {pinhole}");
    }

    #[test]
    fn a_lens_without_distortion_sees_what_a_camera_sees() {
        let camera = CAMERA.resized(64, 36);
        let [fx, fy, cx, cy] = [camera.fx, camera.fy, camera.cx, camera.cy].map(f64::from);
        let intrinsics = Intrinsics { width: 64, height: 36, fx, fy, cx, cy };
        let lens = Lens::new(intrinsics, Distortion::None).unwrap();
        let (scene, pose) = (quay::mapped(), Filmed::Survey.pose(7.0));
        let light = Light { time: 0.0, caustics: 0.0 };
        let draw = |rays| trace::draw(&scene, &rays, &pose, &light);
        let pairs = draw(Rays::of_lens(&lens)).into_iter().zip(draw(Rays::of_camera(&camera)));
        let close = pairs.filter(|(a, b)| (*a - *b).abs().max_element() < 1e-3).count();
        assert!(close > 64 * 36 * 99 / 100, "{close}");
    }
}
