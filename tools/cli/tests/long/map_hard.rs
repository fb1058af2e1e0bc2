//! `nvsprior map` where something is wrong, poor, or very much: an error that names the file, or a prior.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use nvsprior::vulkan::DeviceKind;
use nvsprior::{Camera, Picture, Prior};
use serde_json::{Value, json};

use crate::common::{Random, engine};
use crate::dive::{Dive, camera_file, save, view};
use crate::scene::{CAMERA, pose};

const MAP: &str = "map --cameras cameras.json --split dive --splats 300 --iterations 30";

/// A dive whose camera file lists these pictures, all of one split.
fn listing(camera: &Camera, files: &[String]) -> Dive {
    let dive = Dive::new();
    let views = files.iter().enumerate();
    let views = views.map(|(t, file)| view(file, t, "dive", &pose((t % 4) as f64)));
    dive.write_json("cameras.json", &camera_file(camera, views.collect()));
    dive
}

/// The training ends with a prior that can be read.
fn trains(dive: &Dive, args: &str) {
    dive.run(&format!("{args} --out a.ply")).ends_with(0);
    let prior = Prior::open(&dive.path("a.ply"), &Default::default()).unwrap();
    assert!(!prior.splats().positions.is_empty());
}

#[test]
fn broken_pictures_are_named() {
    let dive = Dive::new();
    let whole = dive.bytes("images/1.png");
    let half = &whole[..whole.len() / 2];
    for content in [&b""[..], b"no picture", half, &[0; 3000]] {
        std::fs::write(dive.path("images/1.png"), content).unwrap();
        dive.run(&format!("{MAP} --out a.ply")).ends_with(1).says("images/1.png");
    }
    std::fs::remove_file(dive.path("images/1.png")).unwrap();
    std::fs::create_dir(dive.path("images/1.png")).unwrap();
    dive.run(&format!("{MAP} --out a.ply")).ends_with(1).says("images/1.png");
    // Held-out pictures are read before the training, too.
    let dive = Dive::new();
    std::fs::write(dive.path("images/3.png"), half).unwrap();
    dive.run(&format!("{MAP} --out a.ply")).ends_with(1).says("images/3.png");
    assert!(!dive.path("a.ply").exists());
}

#[test]
fn poses_that_are_none_are_named() {
    let dive = Dive::new();
    for (key, value, named) in [
        ("tvec", json!(["nan", 0.0, 0.0]), "tvec"),
        ("tvec", json!([null, 0.0, 0.0]), "tvec"),
        ("qvec", json!([0.0, 0.0, 0.0, 0.0]), "qvec"),
        ("qvec", json!([1.0, 0.0, 0.0, "inf"]), "qvec"),
    ] {
        let mut cameras = dive.json("cameras.json");
        cameras["images"][2][key] = value;
        dive.write_json("bad.json", &cameras);
        let args = MAP.replace("cameras.json", "bad.json");
        let file = cameras["images"][2]["file"].as_str().unwrap().to_owned();
        dive.run(&format!("{args} --out a.ply"))
            .ends_with(1)
            .says("bad.json")
            .says(&file)
            .says(named);
    }
    // Numbers that JSON does not have, or that are too large for it.
    let text = dive.json("cameras.json").to_string();
    for number in ["NaN", "1e999"] {
        let bad = text.replacen("\"tvec\":[", &format!("\"tvec\":[{number},"), 1);
        std::fs::write(dive.path("bad.json"), bad).unwrap();
        let args = MAP.replace("cameras.json", "bad.json");
        dive.run(&format!("{args} --out a.ply")).ends_with(1).says("bad.json");
    }
}

#[test]
fn several_cameras_train_one_prior() {
    // Other intrinsics, the same size.
    let dive = Dive::new();
    let mut cameras = dive.json("cameras.json");
    cameras["images"][1]["fx"] = json!(150.0);
    cameras["images"][1]["cx"] = json!(70.0);
    dive.write_json("cameras.json", &cameras);
    trains(&dive, MAP);
    // Other sizes: half as large, and of another shape.
    for (width, height) in [(80, 45), (120, 90)] {
        let picture = dive.picture("images/1.png");
        let image = image::RgbImage::from_raw(160, 90, picture.data).unwrap();
        let filter = image::imageops::FilterType::Triangle;
        image::imageops::resize(&image, width, height, filter)
            .save(dive.path(&format!("images/{width}.png")))
            .unwrap();
        let mut cameras = dive.json("cameras.json");
        let ratio = [f64::from(width) / 160.0, f64::from(height) / 90.0];
        let own = [
            ("file", json!(format!("images/{width}.png"))),
            ("width", json!(width)),
            ("height", json!(height)),
            ("fx", json!(130.0 * ratio[0])),
            ("fy", json!(130.0 * ratio[1])),
            ("cx", json!(80.0 * ratio[0])),
            ("cy", json!(45.0 * ratio[1])),
        ];
        own.into_iter().for_each(|(key, value)| cameras["images"][1][key] = value);
        dive.write_json("cameras.json", &cameras);
        trains(&dive, MAP);
    }
}

#[test]
fn one_picture_and_black_ones_train_a_prior() {
    let dive = listing(&CAMERA, &["images/0.png".to_owned()]);
    trains(&dive, MAP);
    let files: Vec<String> = (0..4).map(|t| format!("images/{t}.png")).collect();
    let dive = listing(&CAMERA, &files);
    for file in &files {
        save(&Picture::new(CAMERA.width, CAMERA.height), &dive.path(file));
    }
    trains(&dive, &MAP.replace("30", "300"));
}

#[test]
fn points_that_are_none_are_named_and_no_points_are_no_error() {
    let dive = Dive::new();
    let header = |count: usize| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex {count}\nproperty float x\nproperty float y\n\
             property float z\nend_header\n"
        )
    };
    for (content, named) in [
        (header(2) + "0 0 4\n0 nan 4\n", "point 1"),
        (header(1) + "0 inf 4\n", "point 0"),
        (header(3) + "0 0 4\n", "points.ply"),
        (String::new(), "points.ply"),
    ] {
        std::fs::write(dive.path("points.ply"), content).unwrap();
        let run = dive.run(&format!("{MAP} --out a.ply --points points.ply")).ends_with(1);
        run.says("points.ply").says(named);
    }
    std::fs::write(dive.path("points.ply"), header(0)).unwrap();
    dive.run(&format!("{MAP} --out a.ply --points points.ply")).ends_with(0).says("random ones");
}

#[test]
fn masks_are_found_or_named() {
    let dive = Dive::new();
    dive.run(&format!("{MAP} --out a.ply --masks none")).ends_with(1).says("none");
    std::fs::create_dir_all(dive.path("masks/images")).unwrap();
    let white = image::GrayImage::from_pixel(CAMERA.width, CAMERA.height, image::Luma([255]));
    white.save(dive.path("masks/images/1.png")).unwrap();
    trains(&dive, &format!("{MAP} --masks masks"));
}

#[test]
fn a_report_that_cannot_be_written_is_named_before_any_work() {
    let dive = Dive::new();
    std::fs::write(dive.path("file"), b"").unwrap();
    for folder in ["file", "file/report"] {
        dive.run(&format!("{MAP} --out a.ply --report {folder}")).ends_with(1).says(folder);
    }
    assert!(!dive.path("a.ply").exists());
}

/// The bytes of a training's state and of its prior, for `MAP`.
const STATE: u64 = 300 * 23 * 12;

#[cfg(unix)]
#[test]
fn a_full_disk_keeps_what_is_there() {
    let dive = Dive::new();
    dive.run(&format!("{MAP} --out a.ply")).ends_with(0);
    let prior = dive.bytes("a.ply");
    assert!((prior.len() as u64) < STATE / 2);
    // A state cannot be saved: training goes on, to the same prior.
    let args = format!("{MAP} --out b.ply --save-every 0");
    let (code, said) = dive.run_limited(STATE / 2, &args);
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("warning: ") && said.contains("b.ply.training"), "{said}");
    assert_eq!(dive.bytes("b.ply"), prior);
    assert!(!dive.path("b.ply.training").exists());
    // Neither state nor prior can be written: an earlier prior and an earlier state stay.
    std::fs::write(dive.path("c.ply"), b"an earlier prior").unwrap();
    let state = killed_at(&dive, "c.ply", 8, false);
    let args = format!("{MAP} --out c.ply --save-every 0 --resume");
    let (code, said) = dive.run_limited(4096, &args);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("c.ply"), "{said}");
    assert_eq!(dive.bytes("c.ply"), b"an earlier prior");
    assert_eq!(dive.bytes("c.ply.training"), state);
    // With room again it ends as if nothing had been.
    dive.run(&args).ends_with(0).says("goes on from step");
    assert_eq!(dive.bytes("c.ply"), prior);
    let mut left: Vec<_> = names(&dive.path(""));
    left.retain(|name| name.contains("c.ply"));
    assert_eq!(left, ["c.ply"]);
}

/// A report that cannot be written later on is no reason to end.
#[cfg(unix)]
#[test]
fn a_full_disk_does_not_end_training_for_its_report() {
    let dive = Dive::new();
    let args = format!("{MAP} --out a.ply --report report");
    let (code, said) = dive.run_limited(40_960, &args);
    assert!(dive.path("a.ply").exists(), "{code:?} {said}");
    assert!(said.contains("warning: report: "), "{said}");
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut names: Vec<_> =
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// Trains until the state of at least this step is saved, then kills the process; the state's bytes. `resumed`: goes on
/// from the state that is there.
fn killed_at(dive: &Dive, out: &str, step: u32, resumed: bool) -> Vec<u8> {
    let mut args = format!("{MAP} --out {out} --save-every 0");
    if resumed {
        args += " --resume";
    }
    let mut child = start(dive, &args);
    let saved = dive.path(&format!("{out}.training"));
    while saved_step(&saved) < step && child.try_wait().unwrap().is_none() {
        std::thread::sleep(Duration::from_millis(2));
    }
    // It may have ended between the look and the kill.
    let _ = child.kill();
    child.wait().unwrap();
    std::fs::read(&saved).unwrap_or_default()
}

fn start(dive: &Dive, args: &str) -> std::process::Child {
    Command::new(env!("CARGO_BIN_EXE_nvsprior"))
        .args(args.split_whitespace())
        .current_dir(dive.path(""))
        .stderr(Stdio::null())
        .stdout(Stdio::null())
        .spawn()
        .unwrap()
}

/// The step of a saved state, 0 without one.
fn saved_step(saved: &Path) -> u32 {
    let bytes = std::fs::read(saved).unwrap_or_default();
    bytes.get(12..16).map_or(0, |word| u32::from_le_bytes([word[0], word[1], word[2], word[3]]))
}

/// Killed at any moment: before a state is there, while one is written, between two.
#[test]
fn killed_ten_times_it_ends_with_the_same_prior() {
    let dive = Dive::new();
    let long = |args: &str| args.replace("--iterations 30", "--iterations 120");
    dive.run(&format!("{} --out whole.ply", long(MAP))).ends_with(0);
    let saved = dive.path("cut.ply.training");
    let args = format!("{} --out cut.ply --save-every 0 --resume", long(MAP));
    let mut random = Random::new(10);
    let mut killed = 0;
    for _ in 0..10 {
        let mut child = start(&dive, &args);
        // After some more steps, and then at any moment of the next few.
        let step = saved_step(&saved) + (random.bits() % 14) as u32;
        while saved_step(&saved) < step && child.try_wait().unwrap().is_none() {
            std::thread::sleep(Duration::from_millis(1));
        }
        std::thread::sleep(Duration::from_micros(random.bits() % 60_000));
        killed += u32::from(child.try_wait().unwrap().is_none());
        let _ = child.kill();
        child.wait().unwrap();
    }
    assert!(killed >= 5, "only {killed} runs were killed before they ended");
    if !dive.path("cut.ply").exists() {
        dive.run(&args).ends_with(0);
    }
    assert_eq!(dive.bytes("cut.ply"), dive.bytes("whole.ply"));
    let mut left = names(&dive.path(""));
    left.retain(|name| name.contains("cut.ply"));
    assert_eq!(left, ["cut.ply"], "halves of files are left");
}

#[test]
fn what_the_device_has_no_room_for_is_refused_at_once() {
    let dive = Dive::new();
    if engine().device().kind != DeviceKind::Cpu {
        println!("skipped: this device may have room for it");
        return;
    }
    let args = MAP.replace("--splats 300", "--splats 16000000 --sh-degree 3");
    let run = dive.run(&format!("{args} --out a.ply")).ends_with(1);
    run.says("16000000 splats of degree 3").says("splats of this degree would fit");
    let mut cameras: Value = dive.json("cameras.json");
    (cameras["width"], cameras["height"]) = (json!(8000), json!(4500));
    dive.write_json("cameras.json", &cameras);
    let run = dive.run(&format!("{MAP} --width 0 --out a.ply")).ends_with(1);
    run.says("8000×4500").says("pixels wide would fit");
}
