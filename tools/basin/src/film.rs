//! The frames of a dive at the tower, in the order of time: each exposed by what the ones before showed.

use std::ops::Range;

use glam::Vec3;
use nvsprior::{Camera, Pose};

use super::exposure::{AutoExposure, Exposure};
use super::frame::{Conditions, DemoFrame};
use super::night::{self, Drawn};
use super::noise::{Stream, hash};
use super::response::Response;
use super::rig::Rig;
use super::scene::Scene;
use super::snow;
use super::trace::Rays;

/// A dive as a camera takes it.
pub struct Film {
    pub scene: Scene,
    pub camera: Camera,
    pub rig: Rig,
    pub conditions: Conditions,
    /// Where the rig's first camera is at a second of the dive.
    pub path: Box<dyn Fn(f64) -> Pose>,
    /// Seconds from frame to frame.
    pub step: f64,
    /// Tells dives apart.
    pub tag: u32,
}

/// Width of the pictures that light is metered by.
const METERED: u32 = 32;
/// Flakes in a cubic metre for one of [`Conditions::snow`].
const FLAKES: f32 = 18.0;

impl Film {
    /// Draws frames by their index. They are asked for in their order; those between are metered, and not drawn.
    pub fn into_frames(self) -> Box<dyn FnMut(usize) -> DemoFrame> {
        let mut held = None;
        Box::new(move |index| {
            let (from, before) = held.unwrap_or_else(|| (0, self.settled()));
            let state = self.metered(before, from..index);
            held = Some((index, state));
            self.frame(index, &state.at((index as f64 * self.step) as f32))
        })
    }

    fn frame(&self, index: usize, exposure: &Exposure) -> DemoFrame {
        let time = index as f64 * self.step;
        let moments = self.moments(time, exposure.shutter);
        let vehicle = (self.path)(time);
        let rays = Rays::of_camera(&self.camera);
        let mut drawn = night::draw(&self.scene, &rays, &self.rig, &moments, &vehicle);
        let seed = (self.tag << 24) ^ (self.rig.tag() << 20) ^ index as u32;
        self.let_snow_fall(&mut drawn, &moments, seed);
        let response = Response::of(self.rig.camera);
        let mut noise = Stream::new(hash(seed ^ 0x0401_5e00));
        let steps = self.conditions.noise;
        let picture = response.picture(&drawn.radiance, &self.camera, exposure, steps, &mut noise);
        let pose = self.rig.pose(&vehicle);
        DemoFrame { name: format!("{:04}.png", index + 1), picture, pose, time }
    }

    /// Where the vehicle is at four moments of an exposure about a time.
    fn moments(&self, time: f64, shutter: f64) -> [Pose; 4] {
        [-0.375, -0.125, 0.125, 0.375].map(|part| (self.path)(time + part * shutter))
    }

    fn let_snow_fall(&self, drawn: &mut Drawn, moments: &[Pose; 4], seed: u32) {
        let density = FLAKES * self.conditions.snow as f32;
        let mut draws = Stream::new(hash(seed ^ 0x0005_0040));
        snow::fall(drawn, &self.scene, &self.camera, &self.rig, moments, density, &mut draws);
    }

    /// The camera's exposure when it has looked at the first frame for long.
    fn settled(&self) -> AutoExposure {
        AutoExposure::settled(self.mean(0), (self.tag + 3 * self.rig.tag()) as f32)
    }

    /// The camera's exposure after some frames more.
    fn metered(&self, before: AutoExposure, frames: Range<usize>) -> AutoExposure {
        frames.fold(before, |state, frame| state.after(self.mean(frame), self.step as f32))
    }

    /// Mean radiance of a frame, by a small picture.
    fn mean(&self, index: usize) -> Vec3 {
        let vehicle = (self.path)(index as f64 * self.step);
        let small = self.camera.resized(METERED, METERED * 9 / 16);
        let (rays, still) = (Rays::of_camera(&small), [vehicle; 4]);
        let drawn = night::draw(&self.scene, &rays, &self.rig, &still, &vehicle);
        drawn.radiance.iter().sum::<Vec3>() / drawn.radiance.len() as f32
    }
}

#[cfg(test)]
mod tests {
    use super::super::solid::Group;
    use super::super::{
        Course, Dive, Lamps, MappingRun, RigCamera, Run, Site, dive_by, mapping_run_by,
    };
    use super::super::{tower, trajectory};
    use super::*;
    use nvsprior::Picture;

    const STILL: Conditions = Conditions { caustics: 0.0, snow: 0, noise: 0.0 };
    const WIDE: Rig = Rig { lens: Rig::WIDE, camera: RigCamera::First, lamps: Lamps::Both };

    /// A small picture of the approach.
    fn approach(rig: Rig, index: usize, conditions: Conditions) -> DemoFrame {
        let run = MappingRun { site: Site::Tower, course: Course::Approach, rig };
        mapping_run_by(rig.pinhole(96), run, conditions).nth(index).unwrap()
    }

    /// Radiance of a small picture, by rows of 48.
    fn radiance(scene: &Scene, rig: &Rig, moments: &[Pose; 4]) -> Vec<Vec3> {
        let rays = Rays::of_camera(&rig.pinhole(48));
        night::draw(scene, &rays, rig, moments, &moments[1]).radiance
    }

    /// Mean radiance of some columns.
    fn columns(radiance: &[Vec3], from: usize, to: usize) -> f32 {
        let of_row = |row: &[Vec3]| row[from..to].iter().map(|v| v.y).sum::<f32>();
        radiance.chunks_exact(48).map(of_row).sum::<f32>() / (27 * (to - from)) as f32
    }

    fn side(picture: &Picture, right: bool) -> f64 {
        let width = picture.width as usize;
        let of_row = |row: &[u8]| {
            let half = if right { &row[3 * width / 2..] } else { &row[..3 * width / 2] };
            half.iter().map(|v| f64::from(*v)).sum::<f64>()
        };
        picture.data.chunks_exact(3 * width).map(of_row).sum()
    }

    #[test]
    fn backscatter_grows_towards_the_lamps() {
        let mut open = tower::mapped();
        open.groups.clear();
        open.enclosure = Group::new(Vec::new());
        let pose = [Course::Approach.pose(0.0); 4];
        let of = |lamps| radiance(&open, &Rig { lamps, ..WIDE }, &pose);
        let [both, left, right] = [Lamps::Both, Lamps::Left, Lamps::Right].map(of);
        let between = (8..40).map(|i| columns(&both, i, i + 1)).fold(f32::MAX, f32::min);
        assert!(columns(&both, 0, 8) > 1.5 * between && columns(&both, 46, 48) > 1.1 * between);
        assert!(columns(&left, 0, 8) > 10.0 * columns(&left, 40, 48));
        assert!(columns(&right, 40, 48) > 10.0 * columns(&right, 0, 8));
    }

    #[test]
    fn the_tower_throws_shadows_into_the_water() {
        let scene = tower::mapped();
        let (rig, pose) = (Rig { lamps: Lamps::Left, ..WIDE }, [Course::Approach.pose(30.0); 4]);
        let black = |scene: &Scene| {
            let rays = Rays::of_camera(&rig.pinhole(48));
            let drawn = night::draw(scene, &rays, &rig, &pose, &pose[0]);
            // Where nothing but water is seen.
            std::iter::zip(drawn.range, drawn.radiance)
                .map(|(r, v)| (r == night::SIGHT, v.y))
                .collect::<Vec<_>>()
        };
        let mut open = scene.clone();
        open.groups.clear();
        let pairs = std::iter::zip(black(&scene), black(&open)).filter(|(a, b)| a.0 && b.0);
        let (mut seen, mut darker) = (0, 0);
        for ((_, shaded), (_, free)) in pairs {
            assert!(shaded <= free * 1.0001);
            (seen, darker) = (seen + 1, darker + usize::from(shaded < 0.98 * free));
        }
        assert!(seen > 100 && darker > seen / 20, "{darker} of {seen} are darker");
    }

    #[test]
    fn a_lamp_that_is_out_darkens_its_side() {
        let scene = tower::mapped();
        let pose = [Course::Approach.pose(12.0); 4];
        let of = |lamps| radiance(&scene, &Rig { lamps, ..WIDE }, &pose);
        let [both, left, right] = [Lamps::Both, Lamps::Left, Lamps::Right].map(of);
        let kept = |one: &[Vec3], from, to| columns(one, from, to) / columns(&both, from, to);
        assert!(kept(&left, 0, 24) > 1.2 * kept(&left, 24, 48));
        assert!(kept(&right, 24, 48) > 1.2 * kept(&right, 0, 24));
        // The camera opens up, and its pictures have a dark side all the same.
        let lit = |lamps| approach(Rig { lamps, ..WIDE }, 8, STILL).picture;
        let share = |picture: &Picture| side(picture, true) / side(picture, false);
        assert!(share(&lit(Lamps::Right)) > 1.3 * share(&lit(Lamps::Left)));
    }

    #[test]
    fn snow_shows_in_every_picture() {
        for lens in [Rig::NARROW, Rig::WIDE] {
            let rig = Rig { lens, ..WIDE };
            let snow = approach(rig, 3, Conditions { snow: 6, ..STILL }).picture;
            let clear = approach(rig, 3, STILL).picture;
            let pairs = std::iter::zip(&snow.data, &clear.data);
            let brighter = pairs.filter(|(a, b)| **a > b.saturating_add(12)).count();
            assert!((60..6000).contains(&brighter), "{lens}: {brighter} values");
        }
    }

    #[test]
    fn the_second_camera_sees_the_same_otherwise() {
        let [first, second] = [RigCamera::First, RigCamera::Second]
            .map(|camera| approach(Rig { camera, ..Rig::default() }, 6, STILL));
        assert!((first.pose.centre() - second.pose.centre()).length() > 0.19);
        assert!(first.picture.psnr(&second.picture) < 22.0);
        let red = |picture: &Picture| {
            let of = |channel| picture.data.iter().skip(channel).step_by(3).map(|v| f64::from(*v));
            of(0).sum::<f64>() / of(2).sum::<f64>()
        };
        assert!(red(&second.picture) > 1.1 * red(&first.picture));
    }

    #[test]
    fn bare_steel_is_overexposed() {
        for index in [4, 14, 23] {
            let picture = approach(Rig::default(), index, STILL).picture;
            let full = picture.data.chunks_exact(3).filter(|pixel| pixel.contains(&255)).count();
            let share = full as f64 / (96.0 * 54.0);
            assert!((0.002..0.15).contains(&share), "picture {index}: {share}");
        }
    }

    #[test]
    fn a_moving_camera_blurs() {
        let scene = tower::mapped();
        let rig = Rig::default();
        let moved = |step: f64| {
            let at = |k: f64| Course::Arcs.pose(20.0 + k * step);
            radiance(&scene, &rig, &[at(-1.5), at(-0.5), at(0.5), at(1.5)])
        };
        let edges = |radiance: &[Vec3]| {
            let steps = radiance.windows(2).map(|pair| (pair[0].y - pair[1].y).powi(2));
            steps.sum::<f32>()
        };
        assert!(edges(&moved(0.15)) < 0.9 * edges(&moved(0.0)));
        let film = |shutter: f64| {
            let path = Box::new(|time| trajectory::tower::inspection_pose(0, time));
            let (scene, camera, tag, step) = (scene.clone(), rig.pinhole(48), 0, 0.3);
            let film = Film { scene, camera, rig, conditions: STILL, path, step, tag };
            let [a, .., b] = film.moments(9.0, shutter);
            (a.centre() - b.centre()).length()
        };
        assert!(film(0.08) > 3.9 * film(0.02) && film(0.02) > 0.0);
    }

    #[test]
    fn the_camera_stops_down_as_it_comes_near_and_passed_frames_count() {
        let dive = Dive { rig: WIDE, ..Dive::of(Run::T7) };
        let all: Vec<DemoFrame> = dive_by(WIDE.pinhole(48), dive, 4, Conditions::CALM).collect();
        let last = dive_by(WIDE.pinhole(48), dive, 4, Conditions::CALM).nth(3).unwrap();
        assert_eq!(all[3].picture, last.picture);
        let film = Film {
            scene: tower::mapped(),
            camera: WIDE.pinhole(48),
            rig: WIDE,
            conditions: STILL,
            path: Box::new(|time| Course::Approach.pose(time)),
            step: trajectory::tower::MAPPING_STEP,
            tag: 0,
        };
        let far = film.settled();
        let gain = |state: AutoExposure| state.at(0.0).gain.y;
        assert!(gain(film.metered(far, 0..22)) < 0.5 * gain(far));
    }
}
