//! What integration tests share: an engine, deterministic random scenes, cameras and poses.
#![allow(dead_code)] // Each test binary uses a part.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use nvsprior::prior::Splats;
use nvsprior::prior::blocked::BlockedWriter;
pub use nvsprior::random::Random;
use nvsprior::vulkan::{DeviceOptions, Error};
use nvsprior::{Camera, Engine, Pose, Prior, RenderOptions, RenderOverrides};

/// The engine of this process, under the validation layer if that is installed.
pub fn engine() -> Engine {
    static ENGINE: OnceLock<Engine> = OnceLock::new();
    ENGINE.get_or_init(open_engine).clone()
}

fn open_engine() -> Engine {
    let checked = DeviceOptions { validation: true, ..DeviceOptions::default() };
    match Engine::new(&checked) {
        Err(Error::NoValidationLayer) => {
            println!("skipped: validation, as its layer is not installed");
            Engine::new(&DeviceOptions::default()).expect("a Vulkan device")
        }
        engine => engine.expect("a Vulkan device"),
    }
}

/// Fails if the validation layer had anything to say.
pub fn assert_silent(engine: &Engine) {
    assert_eq!(engine.validation_messages(), Vec::<String>::new(), "validation messages");
}

/// `count` splats in front of a camera at the origin, some beside and behind it; means 2 to 8 units
/// away, sizes 0.02 to 0.2 units, every opacity, colours mostly within [0, 1].
pub fn random_splats(seed: u64, count: usize, sh_degree: u32) -> Splats {
    let mut random = Random::new(seed);
    let mut splats = Splats { sh_degree, ..Splats::default() };
    for _ in 0..count {
        let z = random.within(-1.0, 8.0);
        let spread = 0.7 * z.abs().max(2.0);
        let (x, y) = (random.within(-spread, spread), random.within(-spread, spread));
        splats.positions.push([x, y, z]);
        splats.log_scales.push(random.triple(-4.0, -1.6));
        splats.rotations.push(std::array::from_fn(|_| random.within(-1.0, 1.0)));
        // About one in four is opaque enough for the clamp of alpha.
        splats.opacity_logits.push(random.within(-4.0, 7.5));
        splats.sh.extend(random.triple(-1.8, 1.8));
        let rest = splats.sh_stride() - 3;
        splats.sh.extend(std::iter::repeat_with(|| random.within(-0.25, 0.25)).take(rest));
    }
    splats
}

/// [`random_splats`] as a prior, rendered as gsplat does.
pub fn random_prior(seed: u64, count: usize, sh_degree: u32) -> Prior {
    let splats = random_splats(seed, count, sh_degree);
    Prior::from_splats(splats, RenderOptions::GSPLAT).expect("valid splats")
}

/// A camera of about 60° across, its principal point beside the middle.
pub fn camera(width: u32, height: u32) -> Camera {
    let (w, h) = (width as f32, height as f32);
    Camera { width, height, fx: 0.86 * w, fy: 0.88 * w, cx: 0.5 * w + 0.3, cy: 0.5 * h - 0.2 }
}

/// A pose near the origin of random scenes, looking into them.
pub fn random_pose(seed: u64) -> Pose {
    let mut random = Random::new(seed ^ 0x706f_7365);
    let [a, b, c] = random.triple(-0.3, 0.3).map(f64::from);
    let [d, e, f] = random.triple(-0.15, 0.15).map(f64::from);
    Pose::exp(&[a, b, c, d, e, f])
}

/// Even random floats in [0, 1]: a frame of height × width × 3.
pub fn random_frame(seed: u64, camera: &Camera) -> Vec<f32> {
    let mut random = Random::new(seed ^ 0x66_7261_6d65);
    (0..camera.pixels() * 3).map(|_| random.within(0.0, 1.0)).collect()
}

/// A file of the reef set, if `shared/data/reef` lies beside the repository or above it; says so if it does not.
pub fn reef_file(name: &str) -> Option<PathBuf> {
    let file = Path::new("shared/data/reef").join(name);
    let above = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().skip(1);
    let found = above.map(|folder| folder.join(&file)).find(|path| path.exists());
    if found.is_none() {
        println!("skipped: {} is not here", file.display());
    }
    found
}

/// The reef prior, rendered as it was trained.
pub fn reef_prior() -> Option<Prior> {
    let path = reef_file("prior.ply")?;
    let overrides = RenderOverrides {
        near: Some(RenderOptions::INRIA.near),
        alpha_max: Some(RenderOptions::INRIA.alpha_max),
        ..RenderOverrides::default()
    };
    Some(Prior::open(&path, &overrides).expect("the reef prior"))
}

/// The reef set's camera, 320×180.
pub const REEF_CAMERA: Camera =
    Camera { width: 320, height: 180, fx: 274.361_85, fy: 274.361_85, cx: 160.0, cy: 90.0 };

/// The pose of the reef set's first picture.
pub fn reef_pose() -> Pose {
    let q = [0.999_346_584, -0.015_059_814, -0.028_719_738, -0.015_961_938];
    Pose::from_wxyz(q, [-0.678_934_667, -2.736_716_17, 5.398_765_727]).expect("a pose")
}

/// Writes a prior in blocks of at most so many splats. The splats are rounded, so it is another prior.
pub fn write_blocked(path: &Path, prior: &Prior, block: usize) {
    let file = std::fs::File::create(path).unwrap();
    let writer = BlockedWriter { block, ..BlockedWriter::default() };
    writer.write(prior.splats(), &prior.besides(), file, &mut |_| ()).unwrap();
}
