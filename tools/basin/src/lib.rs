//! Scenes that the program draws itself, seen through water on mapping runs and inspection runs. The basin is of the
//! paper's kind; the quay is one that nothing in the library was trained on; the tower stands in black water, and is
//! lit by the vehicle's own lamps. They share no code with the splat renderer.

// Not published: names that tell what they are need no comment.
#![allow(missing_docs)]

mod ageing;
mod basin;
mod chain;
mod export;
mod exposure;
mod film;
mod frame;
mod growth;
mod lamp;
mod light;
mod material;
mod medium;
mod night;
mod noise;
mod quay;
mod response;
mod rig;
mod run;
mod safety_line;
mod scene;
mod sensor;
mod site;
mod snow;
mod solid;
mod survey;
mod tower;
mod trace;
mod trajectory;
mod water;

use nvsprior::{Camera, Pose};

pub use export::write_run;
pub use frame::{Conditions, DemoFrame};
pub use rig::{Lamps, Rig, RigCamera};
pub use run::{Dive, Run};
pub use site::Site;
pub use survey::{COURSE, Filmed, survey, survey_lens};
pub use trajectory::FRAME_RATE;
pub use trajectory::tower::Course;

use film::Film;
use frame::drawn;
use light::Light;
use nvsprior::random::Random;
use scene::Scene;
use sensor::Disturbance;
use trace::Rays;
use trajectory::tower::MAPPING_STEP;

/// The camera of all runs, unless another width is asked for: 320 × 180 pixels, 70° wide (`fx = 160 / tan 35°`).
pub const CAMERA: Camera =
    Camera { width: 320, height: 180, fx: 228.503_7, fy: 228.503_7, cx: 160.0, cy: 90.0 };

/// [`CAMERA`] at another width: the same field of view, 16:9.
pub fn camera_of_width(width: u32) -> Camera {
    CAMERA.resized(width, (9 * width + 8) / 16)
}

/// The prior: trained from the pictures of the mapping run M1 by `nvsprior map` (`make demo-prior`), .nvsg. Its doubt
/// is in it.
pub const PRIOR: &[u8] = include_bytes!("../prior.nvsg");

/// The frames of a site's mapping run, each drawn when asked for. The tower's: on both courses, by the first rig.
pub fn mapping_run(site: Site, conditions: Conditions) -> impl ExactSizeIterator<Item = DemoFrame> {
    mapping_run_by(CAMERA, MappingRun::of(site), conditions)
}

/// A site's mapping run. Course and rig: of the tower.
#[derive(Clone, Copy, Debug)]
pub struct MappingRun {
    pub site: Site,
    pub course: Course,
    pub rig: Rig,
}

impl MappingRun {
    pub fn of(site: Site) -> MappingRun {
        MappingRun { site, course: Course::Both, rig: Rig::default() }
    }
}

/// As [`mapping_run`], with another camera than [`CAMERA`].
pub fn mapping_run_by(
    camera: Camera,
    run: MappingRun,
    conditions: Conditions,
) -> impl ExactSizeIterator<Item = DemoFrame> {
    let MappingRun { site, course, rig } = run;
    let scene = site.mapped();
    let tag = match site {
        Site::Basin => 0,
        Site::Quay => 4,
        Site::Row => 8,
        Site::Tower => 12,
    };
    if site.has_lamps() {
        let path = Box::new(move |time| course.pose(time));
        let film = Film { scene, camera, rig, conditions, path, step: MAPPING_STEP, tag };
        return drawn(course.pictures(), film.into_frames());
    }
    let poses = site.mapping_poses();
    let draw = move |index| {
        // The mapping run takes its time: a picture every 4 seconds.
        draw(&scene, &camera, &conditions, poses[index], index, 4.0 * index as f64, tag)
    };
    drawn(site.mapping_poses().len(), Box::new(draw))
}

/// The first `frames` frames of an inspection run, each drawn when asked for.
pub fn inspection_run(
    run: Run,
    frames: usize,
    conditions: Conditions,
) -> impl ExactSizeIterator<Item = DemoFrame> {
    inspection_run_by(CAMERA, run, frames, conditions)
}

/// As [`inspection_run`], with another camera than [`CAMERA`].
pub fn inspection_run_by(
    camera: Camera,
    run: Run,
    frames: usize,
    conditions: Conditions,
) -> impl ExactSizeIterator<Item = DemoFrame> {
    dive_by(camera, Dive::of(run), frames, conditions)
}

/// The first `frames` frames of a dive, each drawn when asked for.
pub fn dive_by(
    camera: Camera,
    dive: Dive,
    frames: usize,
    conditions: Conditions,
) -> impl ExactSizeIterator<Item = DemoFrame> {
    let scene = dive.scene();
    if dive.run.site().has_lamps() {
        let path = Box::new(move |time| dive.pose(time));
        let (rig, step, tag) = (dive.rig, 1.0 / dive.rate, dive.tag());
        let film = Film { scene, camera, rig, conditions, path, step, tag };
        return drawn(frames, film.into_frames());
    }
    let draw = move |index| {
        let time = index as f64 / dive.rate;
        let pose = dive.pose(time);
        let draw = |scene: &Scene| draw(scene, &camera, &conditions, pose, index, time, dive.tag());
        match dive.run {
            Run::T2 => draw(&scene.clone().with(safety_line::solids(&pose, time))),
            _ => draw(&scene),
        }
    };
    drawn(frames, Box::new(draw))
}

/// Views of the basin as mapped, from anywhere in the free water: the first `count` of a fixed sequence. Each is drawn
/// when asked for.
pub fn random_views(
    camera: Camera,
    count: usize,
    conditions: Conditions,
) -> impl ExactSizeIterator<Item = DemoFrame> {
    let scene = basin::mapped();
    let mut random = Random::new(VIEWS_SEED);
    let even = std::iter::repeat_with(|| random.even());
    let poses: Vec<Pose> = trajectory::basin::random_poses(even).take(count).collect();
    let draw = move |index: usize| {
        draw(&scene, &camera, &conditions, poses[index], index, 4.0 * index as f64, 3)
    };
    drawn(count, Box::new(draw))
}

const VIEWS_SEED: u64 = 11;

fn draw(
    scene: &Scene,
    camera: &Camera,
    conditions: &Conditions,
    pose: Pose,
    index: usize,
    time: f64,
    run_tag: u32,
) -> DemoFrame {
    // Runs are hours apart: the water's surface is at another moment of its motion.
    let light =
        Light { time: time as f32 + 1000.0 * run_tag as f32, caustics: conditions.caustics };
    let radiance = trace::draw(scene, &Rays::of_camera(camera), &pose, &light);
    let disturbance = Disturbance { snow: conditions.snow, noise: conditions.noise };
    let seed = (run_tag << 24) | index as u32;
    let picture = sensor::expose(radiance, camera.width, camera.height, &disturbance, seed);
    DemoFrame { name: format!("{:04}.png", index + 1), picture, pose, time }
}

#[cfg(test)]
mod tests {
    use super::solid::{Group, Material};
    use super::*;
    use nvsprior::Picture;

    /// Nothing but the scene and the water.
    const STILL: Conditions = Conditions { caustics: 0.0, snow: 0, noise: 0.0 };

    #[test]
    fn runs_are_the_same_every_time_and_on_any_number_of_threads() {
        let draw = |threads, run| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| inspection_run(run, 2, Conditions::CALM).nth(1).unwrap().picture)
        };
        for run in Run::ALL {
            assert_eq!(draw(1, run), draw(3, run));
        }
        assert_ne!(draw(2, Run::T1), draw(2, Run::T2));
    }

    #[test]
    fn conditions_disturb_the_still_scene_a_little() {
        for site in Site::ALL {
            let first = |conditions| mapping_run(site, conditions).next().unwrap().picture;
            let psnr = first(Conditions::CALM).psnr(&first(STILL));
            assert!((29.0..45.0).contains(&psnr), "{site:?}: {psnr} dB");
        }
    }

    #[test]
    fn a_camera_of_twice_the_size_sees_the_same() {
        let large = camera_of_width(640);
        let [a, b] = [CAMERA, large]
            .map(|camera| inspection_run_by(camera, Run::T2, 1, STILL).next().unwrap().picture);
        let mut halved = a.clone();
        for (i, value) in halved.data.iter_mut().enumerate() {
            let (x, y, channel) = (i / 3 % 320, i / 3 / 320, i % 3);
            let at = |dx, dy| u32::from(b.data[((2 * y + dy) * 640 + 2 * x + dx) * 3 + channel]);
            *value = ((at(0, 0) + at(1, 0) + at(0, 1) + at(1, 1) + 2) / 4) as u8;
        }
        assert!(a.psnr(&halved) > 30.0, "{} dB", a.psnr(&halved));
    }

    #[test]
    fn cameras_of_all_widths_see_as_far() {
        assert_eq!(camera_of_width(320), CAMERA);
        for (width, height) in [(160, 90), (161, 91), (640, 360), (1280, 720), (1282, 721)] {
            let camera = camera_of_width(width);
            assert_eq!((camera.width, camera.height), (width, height));
            let tangents = [(camera.cx / camera.fx), (camera.cy / camera.fy)];
            let wanted = [(CAMERA.cx / CAMERA.fx), (CAMERA.cy / CAMERA.fy)];
            assert!((0..2).all(|i| (tangents[i] - wanted[i]).abs() < 1e-6), "{camera:?}");
        }
    }

    #[test]
    fn the_line_and_the_object_show_in_t2() {
        let frame = inspection_run(Run::T2, 1, STILL).next().unwrap();
        let empty = draw(&basin::mapped(), &CAMERA, &STILL, frame.pose, 0, frame.time, 2);
        let changed = changed(&frame.picture, &empty.picture);
        assert!((1000..15_000).contains(&changed), "{changed} pixels");
    }

    #[test]
    fn the_crab_pot_shows_in_later_frames_of_t3_only() {
        let mut scene = quay::mapped();
        scene.water = quay::later().water;
        let tag = Dive::of(Run::T3).tag();
        let changed: Vec<usize> = inspection_run(Run::T3, 12, STILL)
            .enumerate()
            .map(|(i, frame)| {
                let empty = draw(&scene, &CAMERA, &STILL, frame.pose, i, frame.time, tag);
                changed(&frame.picture, &empty.picture)
            })
            .collect();
        assert_eq!(changed[..3], [0; 3]);
        assert!(changed[8..].iter().all(|changed| (500..15_000).contains(changed)), "{changed:?}");
    }

    #[test]
    fn the_basin_changes_more_with_every_age() {
        let changed_after = |weeks: f32| {
            let dive = Dive { weeks, rate: 0.1, ..Dive::of(Run::T4) };
            let frames = dive_by(CAMERA, dive, 2, STILL);
            let shares = frames.enumerate().map(|(i, frame)| {
                let tag = dive.tag();
                let mapped =
                    draw(&basin::mapped(), &CAMERA, &STILL, frame.pose, i, frame.time, tag);
                changed(&frame.picture, &mapped.picture)
            });
            shares.sum::<usize>() as f64 / (2 * CAMERA.pixels()) as f64
        };
        assert_eq!(changed_after(0.0), 0.0);
        let [week_4, week_12, week_26] = [4.0, 12.0, 26.0].map(changed_after);
        assert!((0.10..0.25).contains(&week_4), "{week_4}");
        assert!(week_12 > 1.5 * week_4, "{week_12}");
        assert!(week_26 > 1.1 * week_12 && (0.4..0.6).contains(&week_26), "{week_26}");
    }

    #[test]
    fn the_chain_and_the_gap_of_the_brace_show_in_t4_and_t5() {
        for run in [Run::T4, Run::T5] {
            let dive = Dive { rate: 0.4, ..Dive::of(run) };
            let mut unchained = dive.scene();
            let chain = |group: &Group| group.solids[0].material == Material::Chain;
            unchained.groups.retain(|group| !chain(group));
            let brace = basin::pipes().nth(basin::BRACE).unwrap();
            let braced = dive.scene().with(vec![brace]);
            let [mut of_chain, mut of_brace] = [0, 0];
            for (i, frame) in dive_by(CAMERA, dive, 2, STILL).enumerate() {
                let other = |scene| {
                    let tag = dive.tag();
                    let other = draw(scene, &CAMERA, &STILL, frame.pose, i, frame.time, tag);
                    changed(&frame.picture, &other.picture)
                };
                of_chain += other(&unchained);
                of_brace += other(&braced);
            }
            assert!(of_chain > 500 && of_brace > 500, "{run:?}: {of_chain}, {of_brace} pixels");
        }
    }

    #[test]
    fn at_a_higher_rate_more_frames_show_the_same_dive() {
        let frame = |rate: f64, index| {
            let dive = Dive { rate, ..Dive::of(Run::T5) };
            dive_by(CAMERA, dive, index + 1, STILL).nth(index).unwrap()
        };
        let (at_3, at_15) = (frame(3.0, 1), frame(15.0, 5));
        assert_eq!((at_3.time, at_3.pose), (at_15.time, at_15.pose));
        assert_eq!(at_3.picture, at_15.picture);
    }

    #[test]
    fn each_dive_has_its_own_track_light_and_noise() {
        for run in Run::ALL {
            let dives = [1, 2, 5].map(|number| Dive { number, ..Dive::of(run) });
            let [a, b, c] =
                dives.map(|dive| dive_by(CAMERA, dive, 1, Conditions::CALM).next().unwrap());
            assert!(a.pose != b.pose && b.pose != c.pose, "{run:?}");
            if run.site().has_lamps() {
                // No light of the day's to differ.
                continue;
            }
            let again = |tag| {
                let scene = dives[0].scene();
                draw(&scene, &CAMERA, &Conditions::CALM, a.pose, 0, a.time, tag).picture
            };
            assert_ne!(again(dives[0].tag()), again(dives[1].tag()), "{run:?}");
        }
    }

    /// Pixels that differ by more than noise.
    fn changed(a: &Picture, b: &Picture) -> usize {
        let pixels = std::iter::zip(a.data.chunks_exact(3), b.data.chunks_exact(3));
        pixels.filter(|(a, b)| a[0].abs_diff(b[0]) > 20).count()
    }
}
