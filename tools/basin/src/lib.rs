//! Scenes that the program draws itself, seen through water on mapping runs and inspection runs. The basin is of the
//! paper's kind; the quay is one that nothing in the library was trained on. They share no code with the splat
//! renderer.

// Not published: names that tell what they are need no comment.
#![allow(missing_docs)]

mod basin;
mod export;
mod material;
mod noise;
mod quay;
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

/// A place with a mapping run and inspection runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Site {
    /// An indoor basin with a structure of oil barrels.
    Basin,
    /// A harbour's wall of sheet piles, in green water.
    Quay,
}

impl Site {
    pub const ALL: [Site; 2] = [Site::Basin, Site::Quay];

    pub fn mapping_run_name(self) -> &'static str {
        match self {
            Site::Basin => "M1",
            Site::Quay => "M2",
        }
    }

    fn mapped(self) -> Scene {
        match self {
            Site::Basin => basin::mapped(),
            Site::Quay => quay::mapped(),
        }
    }

    fn mapping_poses(self) -> Vec<Pose> {
        match self {
            Site::Basin => trajectory::basin::mapping_poses(),
            Site::Quay => trajectory::quay::mapping_poses(),
        }
    }
}

/// The inspection runs, some time after the mapping run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Run {
    /// The basin as mapped.
    T1,
    /// With a new metallic object beside the structure and the vehicle's safety line in view.
    T2,
    /// The quay on another day: other light, more silt, and after some frames a crab pot with its buoy.
    T3,
}

impl Run {
    pub const ALL: [Run; 3] = [Run::T1, Run::T2, Run::T3];

    pub fn name(self) -> &'static str {
        match self {
            Run::T1 => "T1",
            Run::T2 => "T2",
            Run::T3 => "T3",
        }
    }

    pub fn site(self) -> Site {
        match self {
            Run::T1 | Run::T2 => Site::Basin,
            Run::T3 => Site::Quay,
        }
    }

    /// What stands there, without the safety line.
    fn scene(self) -> Scene {
        match self {
            Run::T1 => basin::mapped(),
            Run::T2 => basin::with_new_object(),
            Run::T3 => quay::later(),
        }
    }

    /// Tells the runs' noise apart.
    fn tag(self) -> u32 {
        match self {
            Run::T1 => 1,
            Run::T2 => 2,
            Run::T3 => 5,
        }
    }

    /// Where the camera is, `time` seconds into the run.
    fn pose(self, time: f64) -> Pose {
        use trajectory::basin::{Track, inspection_pose};
        match self {
            Run::T1 => inspection_pose(&Track::T1, time),
            Run::T2 => inspection_pose(&Track::T2, time),
            Run::T3 => trajectory::quay::inspection_pose(time),
        }
    }
}

/// What may make a frame differ from the still scene.
#[derive(Clone, Copy, Debug)]
pub struct Conditions {
    /// Height of the moving caustics relative to the direct light.
    pub caustics: f32,
    /// Specks of marine snow in each frame.
    pub snow: u32,
    /// Standard deviation of the sensor's noise, in steps of the 8-bit picture.
    pub noise: f32,
}

impl Conditions {
    /// Calm water with little in it.
    pub const CALM: Conditions = Conditions { caustics: 0.10, snow: 6, noise: 1.0 };
}

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

/// The frames of a site's mapping run, each drawn when asked for.
pub fn mapping_run(site: Site, conditions: Conditions) -> impl ExactSizeIterator<Item = DemoFrame> {
    let scene = site.mapped();
    let tag = match site {
        Site::Basin => 0,
        Site::Quay => 4,
    };
    site.mapping_poses().into_iter().enumerate().map(move |(index, pose)| {
        // The mapping run takes its time: a picture every 4 seconds.
        draw(&scene, &CAMERA, &conditions, pose, index, 4.0 * index as f64, tag)
    })
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
    let scene = run.scene();
    (0..frames).map(move |index| {
        let time = index as f64 / FRAME_RATE;
        let pose = run.pose(time);
        let draw = |scene: &Scene| draw(scene, &camera, &conditions, pose, index, time, run.tag());
        match run {
            Run::T2 => draw(&scene.clone().with(safety_line::solids(&pose, time))),
            Run::T1 | Run::T3 => draw(&scene),
        }
    })
}

/// Views of the basin as mapped, from anywhere in the free water: the first `count` of a fixed sequence. Each is drawn
/// when asked for.
pub fn random_views(
    count: usize,
    conditions: Conditions,
) -> impl ExactSizeIterator<Item = DemoFrame> {
    let scene = basin::mapped();
    let mut random = Random::new(VIEWS_SEED);
    let even = std::iter::repeat_with(|| random.even());
    let poses: Vec<Pose> = trajectory::basin::random_poses(even).take(count).collect();
    poses.into_iter().enumerate().map(move |(index, pose)| {
        draw(&scene, &CAMERA, &conditions, pose, index, 4.0 * index as f64, 3)
    })
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
    let radiance = trace::draw(scene, camera, &pose, &light);
    let disturbance = Disturbance { snow: conditions.snow, noise: conditions.noise };
    let seed = (run_tag << 24) | index as u32;
    let picture = sensor::expose(radiance, camera.width, camera.height, &disturbance, seed);
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
            assert!((30.0..45.0).contains(&psnr), "{site:?}: {psnr} dB");
        }
    }

    #[test]
    fn a_camera_of_twice_the_size_sees_the_same() {
        let large = CAMERA.resized(640, 360);
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
        let changed: Vec<usize> = inspection_run(Run::T3, 12, STILL)
            .enumerate()
            .map(|(i, frame)| {
                let empty = draw(&scene, &CAMERA, &STILL, frame.pose, i, frame.time, Run::T3.tag());
                changed(&frame.picture, &empty.picture)
            })
            .collect();
        assert_eq!(changed[..3], [0; 3]);
        assert!(changed[8..].iter().all(|changed| (500..15_000).contains(changed)), "{changed:?}");
    }

    /// Pixels that differ by more than noise.
    fn changed(a: &Picture, b: &Picture) -> usize {
        let pixels = std::iter::zip(a.data.chunks_exact(3), b.data.chunks_exact(3));
        pixels.filter(|(a, b)| a[0].abs_diff(b[0]) > 20).count()
    }
}
