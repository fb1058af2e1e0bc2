//! The files that the C programs work on: a prior, another prior, and pictures of a short dive.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use nvsprior::image::{Clahe, Preprocessing, Preprocessor, WhiteBalance};
use nvsprior::prior::{Extras, KeyFrames, compact, extras_file};
use nvsprior::render::{Plan, Scene};
use nvsprior::{Camera, Decoder, Encoder, EncoderOptions, Engine, Picture, Prior, RenderChecks};

use crate::common::write_blocked;
use crate::wall;

/// Small, so that a frame takes little time even under a memory checker.
const CAMERA: Camera = Camera { width: 96, height: 54, fx: 78.0, fy: 78.0, cx: 48.0, cy: 27.0 };

const FRAMES: usize = 8;

/// The folder of the files. The first call writes them. `scripts/c-test.sh` knows the folder too.
pub fn folder() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("c-scene");
        write(&folder);
        folder
    })
}

/// Writes `prior.ply`, `prior.nvsg`, `prior.nvsb`, `other.ply` with three key frames beside it, `frame-0.ppm` and so
/// on; `preprocessed.ply`, the same prior with a preprocessing, and `treated-0.ppm`, the first frame as that leaves it;
/// `expected-0.nvsp` and `expected-0.ppm`, the first frame's packet and what it shows, by which `scripts/c-test.sh`
/// sees whether the library as it is installed, built by another profile, gives the same bytes; `paper.nvsp` and
/// `paper.ppm`, the same as the paper codes it, which no encoder of the C library does; and `scene.txt`: one
/// line with the camera (width,height,fx,fy,cx,cy), then one line per frame with its pose (qw,qx,qy,qz,tx,ty,tz).
fn write(folder: &Path) {
    std::fs::create_dir_all(folder).unwrap();
    let prior = wall::wall(1);
    let other = folder.join("other.ply");
    wall::write_prior(&folder.join("prior.ply"), &prior);
    write_compact(&folder.join("prior.nvsg"), &prior);
    write_blocked(&folder.join("prior.nvsb"), &prior, 256);
    wall::write_prior(&other, &wall::wall(2));
    let key_frames = (0..3).map(|t| wall::pose(f64::from(t))).collect();
    let key_frames = KeyFrames::new(key_frames).unwrap();
    let extras = Extras { key_frames, ..Extras::default() };
    let id = Prior::open(&other, &Default::default()).unwrap().id();
    let beside = extras_file::to_bytes(&extras, id, wall::wall(2).len());
    std::fs::write(extras_file::path_beside(&other), beside).unwrap();

    let white_balance = WhiteBalance::GrayWorld;
    let preprocessing = Preprocessing { white_balance, clahe: Clahe::new(2.5, 8).ok() };
    let preprocessed = prior.clone().with_preprocessing(preprocessing);
    wall::write_prior(&folder.join("preprocessed.ply"), &preprocessed);
    let engine = Engine::new(&Default::default()).expect("a Vulkan device");
    let scene = engine.upload(&prior).unwrap();
    let mut renderer = engine.renderer(&scene, &CAMERA, Plan::picture()).unwrap();
    let mut picture = Picture::new(CAMERA.width, CAMERA.height);
    let Camera { width, height, fx, fy, cx, cy } = CAMERA;
    let mut text = format!("{width},{height},{fx},{fy},{cx},{cy}\n");
    for t in 0..FRAMES {
        let pose = wall::pose(t as f64);
        renderer.picture(&pose, &mut picture).unwrap();
        add_object(&mut picture);
        write_ppm(&folder.join(format!("frame-{t}.ppm")), &picture);
        if t == 0 {
            write_expected(folder, &engine, &scene, &picture);
            Preprocessor::new(&preprocessing).apply(&mut picture);
            write_ppm(&folder.join("treated-0.ppm"), &picture);
        }
        let numbers = pose.wxyz().into_iter().chain(<[f64; 3]>::from(pose.translation));
        let numbers: Vec<_> = numbers.map(|v| v.to_string()).collect();
        writeln!(text, "{}", numbers.join(",")).unwrap();
    }
    std::fs::write(folder.join("scene.txt"), text).unwrap();
}

/// The first frame as `c-examples/encode_frame.c` and `decode_frame.c` code it.
fn write_expected(folder: &Path, engine: &Engine, scene: &Arc<Scene>, frame: &Picture) {
    let own = EncoderOptions { render_checks: RenderChecks::AsNeeded, ..EncoderOptions::default() };
    let mut encoder = Encoder::new(engine, scene, &CAMERA, own).unwrap();
    let encoded = encoder.encode(frame, Some(wall::pose(0.0))).unwrap();
    std::fs::write(folder.join("expected-0.nvsp"), &encoded.packet).unwrap();
    let decoded = Decoder::new(engine, scene).decode(&encoded.packet).unwrap();
    write_ppm(&folder.join("expected-0.ppm"), &decoded.picture);
}

/// The prior in the compact format. Its splats are rounded, so it is another prior.
fn write_compact(path: &Path, prior: &Prior) {
    let file = std::fs::File::create(path).unwrap();
    compact::write(prior.splats(), &prior.besides(), &Default::default(), file).unwrap();
}

/// Something that the prior does not know.
fn add_object(picture: &mut Picture) {
    let width = picture.width as usize;
    for (i, value) in picture.data.iter_mut().enumerate() {
        let (x, y) = (i / 3 % width, i / 3 / width);
        if (18..30).contains(&x) && (12..24).contains(&y) {
            *value = value.saturating_add(60);
        }
    }
}

fn write_ppm(path: &Path, picture: &Picture) {
    let mut bytes = format!("P6\n{} {}\n255\n", picture.width, picture.height).into_bytes();
    bytes.extend(&picture.data);
    std::fs::write(path, bytes).unwrap();
}
