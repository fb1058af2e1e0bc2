//! The basin: a scene of the paper's kind that the program draws itself, seen through water
//! on a mapping run and two inspection runs. It shares no code with the splat renderer.

mod export;
mod material;
mod noise;
mod safety_line;
mod scene;
mod sensor;
mod solid;
mod trace;
mod trajectory;
mod water;

use nvsprior::{Camera, Picture, Pose};

pub use export::write_run;

use nvsprior::random::Random;
use scene::Scene;
use sensor::Disturbance;
use trajectory::FRAME_RATE;
use water::Light;

/// The camera of all runs: 320 × 180 pixels, 70° wide (`fx = 160 / tan 35°`).
pub const CAMERA: Camera =
    Camera { width: 320, height: 180, fx: 228.503_7, fy: 228.503_7, cx: 160.0, cy: 90.0 };

/// The prior: trained from the pictures of the mapping run M1 by `nvsprior map` (`make demo-prior`), .nvsg.
pub const PRIOR: &[u8] = include_bytes!("../prior.nvsg");

/// The inspection runs, some time after the mapping run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Run {
    /// The scene as mapped.
    T1,
    /// With a new metallic object beside the structure and the vehicle's safety line in view.
    T2,
}

/// What may make a frame differ from the still scene.
#[derive(Clone, Copy, Debug)]
pub struct Conditions {
    /// Height of the moving caustics relative to the lamps' light.
    pub caustics: f32,
    /// Specks of marine snow in each frame.
    pub snow: u32,
    /// Standard deviation of the sensor's noise, in steps of the 8-bit picture.
    pub noise: f32,
}

impl Conditions {
    /// A calm indoor basin.
    pub const BASIN: Conditions = Conditions { caustics: 0.10, snow: 6, noise: 1.0 };
}

/// A picture of a run.
#[derive(Clone, Debug)]
pub struct DemoFrame {
    /// File name without folder, such as `0001.png`.
    pub name: String,
    /// What the camera saw.
    pub picture: Picture,
    /// Where the camera truly was.
    pub pose: Pose,
    /// Seconds since the run began.
    pub time: f64,
}

/// The frames of the mapping run M1, each drawn when asked for.
pub fn mapping_run(conditions: Conditions) -> impl ExactSizeIterator<Item = DemoFrame> {
    let scene = Scene::mapped();
    trajectory::mapping_poses().into_iter().enumerate().map(move |(index, pose)| {
        // The mapping run takes its time: a picture every 4 seconds.
        draw(&scene, &conditions, pose, index, 4.0 * index as f64, 0)
    })
}

/// The first `frames` frames of an inspection run, each drawn when asked for.
pub fn inspection_run(
    run: Run,
    frames: usize,
    conditions: Conditions,
) -> impl ExactSizeIterator<Item = DemoFrame> {
    let (scene, tag) = match run {
        Run::T1 => (Scene::mapped(), 1),
        Run::T2 => (Scene::with_new_object(), 2),
    };
    (0..frames).map(move |index| {
        let time = index as f64 / FRAME_RATE;
        let pose = trajectory::inspection_pose(run, time);
        match run {
            Run::T1 => draw(&scene, &conditions, pose, index, time, tag),
            Run::T2 => {
                let seen = scene.clone().with(safety_line::solids(&pose, time));
                draw(&seen, &conditions, pose, index, time, tag)
            }
        }
    })
}

/// Views of the scene as mapped, from anywhere in the free water: the first `count` of a fixed sequence. Each is drawn
/// when asked for.
pub fn random_views(
    count: usize,
    conditions: Conditions,
) -> impl ExactSizeIterator<Item = DemoFrame> {
    let scene = Scene::mapped();
    let mut random = Random::new(VIEWS_SEED);
    let even = std::iter::repeat_with(|| random.even());
    let poses: Vec<Pose> = trajectory::random_poses(even).take(count).collect();
    poses
        .into_iter()
        .enumerate()
        .map(move |(index, pose)| draw(&scene, &conditions, pose, index, 4.0 * index as f64, 3))
}

/// Seed of the random views.
const VIEWS_SEED: u64 = 11;

fn draw(
    scene: &Scene,
    conditions: &Conditions,
    pose: Pose,
    index: usize,
    time: f64,
    run_tag: u32,
) -> DemoFrame {
    // Runs are hours apart: the water's surface is at another moment of its motion.
    let light =
        Light { time: time as f32 + 1000.0 * run_tag as f32, caustics: conditions.caustics };
    let radiance = trace::draw(scene, &CAMERA, &pose, &light);
    let disturbance = Disturbance { snow: conditions.snow, noise: conditions.noise };
    let seed = (run_tag << 24) | index as u32;
    let picture = sensor::expose(radiance, CAMERA.width, CAMERA.height, &disturbance, seed);
    DemoFrame { name: format!("{:04}.png", index + 1), picture, pose, time }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nothing but the scene and the water.
    const STILL: Conditions = Conditions { caustics: 0.0, snow: 0, noise: 0.0 };

    #[test]
    fn runs_are_the_same_every_time_and_on_any_number_of_threads() {
        let draw = |threads, run| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| inspection_run(run, 2, Conditions::BASIN).nth(1).unwrap().picture)
        };
        for run in [Run::T1, Run::T2] {
            assert_eq!(draw(1, run), draw(3, run));
        }
        assert_ne!(draw(2, Run::T1), draw(2, Run::T2));
    }

    #[test]
    fn conditions_disturb_the_still_scene_a_little() {
        let first = |conditions| mapping_run(conditions).next().unwrap().picture;
        let psnr = first(Conditions::BASIN).psnr(&first(STILL));
        assert!((30.0..45.0).contains(&psnr), "{psnr} dB");
    }

    #[test]
    fn the_line_and_the_object_show_in_t2() {
        let frame = inspection_run(Run::T2, 1, STILL).next().unwrap();
        let empty = draw(&Scene::mapped(), &STILL, frame.pose, 0, frame.time, 2);
        let changed =
            std::iter::zip(frame.picture.data.chunks_exact(3), empty.picture.data.chunks_exact(3));
        let changed = changed.filter(|(a, b)| a[0].abs_diff(b[0]) > 20).count();
        assert!((1000..15_000).contains(&changed), "{changed} pixels");
    }
}
