//! `nvsprior map --parts`: a run in parts.

use std::process::{Command, Stdio};
use std::sync::OnceLock;
use std::time::Duration;

use nvsprior::{Picture, Pose, Prior};
use serde_json::Value;

use crate::common::engine;
use crate::dive::{Dive, camera_file, save, view};
use crate::scene::{CAMERA, frame, wall};

const MAP: &str = "map --cameras run.json --split run --splats 600 --iterations 200 --parts 2";
/// Pictures of the run; every fourth one is held out.
const PICTURES: usize = 16;

fn pose(t: usize) -> Pose {
    let along = t as f64 / (PICTURES - 1) as f64 - 0.5;
    Pose::IDENTITY.stepped(&[-4.0 * along, 0.1 * (t % 3) as f64, 0.0, 0.0, 0.0, 0.0])
}

fn split(t: usize) -> &'static str {
    if t % 4 == 2 { "other" } else { "run" }
}

fn name(t: usize) -> String {
    format!("run/{t}.png")
}

/// A run along the wall: `run.json`, and its points.
fn run() -> Dive {
    static PICTURES_DRAWN: OnceLock<Vec<Picture>> = OnceLock::new();
    let pictures = PICTURES_DRAWN.get_or_init(|| {
        let engine = engine();
        let scene = engine.upload(&wall(1)).unwrap();
        (0..PICTURES).map(|t| frame(&engine, &scene, &pose(t))).collect()
    });
    let dive = Dive::without_frames();
    std::fs::create_dir(dive.path("run")).unwrap();
    for (t, picture) in pictures.iter().enumerate() {
        save(picture, &dive.path(&name(t)));
    }
    let views = (0..PICTURES).map(|t| view(&name(t), t, split(t), &pose(t)));
    dive.write_json("run.json", &camera_file(&CAMERA, views.collect()));
    let wall = wall(1);
    let points = wall.splats().positions.iter().step_by(8);
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nend_header\n",
        points.len()
    );
    points.for_each(|[x, y, z]| text += &format!("{x} {y} {z}\n"));
    std::fs::write(dive.path("points.ply"), text).unwrap();
    dive
}

fn psnr(report: &Value, key: &str) -> f64 {
    report[key].as_f64().unwrap_or_else(|| panic!("{key} of {report}"))
}

#[test]
fn a_run_in_parts_becomes_one_prior() {
    let dive = run();
    let made =
        dive.run(&format!("{MAP} --out a.nvsb --report parts --undistorted flat")).ends_with(0);
    let made = made.says("coarse priors").says("part-2 of 2").says("at borders");
    let report = dive.json("parts/report.json");
    let prior = Prior::open(&dive.path("a.nvsb"), &Default::default()).unwrap();
    assert!(!prior.key_frames().is_empty());
    let parts = report["parts"].as_array().unwrap();
    let number = |part: &Value, key: &str| part[key].as_u64().unwrap();
    let kept: u64 = parts.iter().map(|part| number(part, "splats")).sum();
    // A prior in blocks leaves out splats that show nothing.
    assert!(kept >= prior.len() as u64 && prior.len() > 200, "{kept}, {}", prior.len());
    for part in parts {
        assert!((6..=12).contains(&number(part, "pictures")), "{report}");
        assert!((100..=600).contains(&number(part, "splats")), "{report}");
    }
    let pictures = report["pictures"].as_array().unwrap();
    assert_eq!(pictures.len(), PICTURES / 4);
    assert!(pictures.iter().any(|picture| picture["parts"] == serde_json::json!([1, 2])));
    for file in ["parts/part-1/report.json", "parts/part-2/preview.png", "parts/coarse-2/curve.csv"]
    {
        assert!(!dive.bytes(file).is_empty(), "{file}");
    }
    let flat = dive.json("flat/cameras.json");
    assert_eq!(flat["images"].as_array().unwrap().len(), PICTURES);
    assert!(!dive.path("a.nvsb.parts").exists(), "{}", made.stderr);
    let encode = "encode --prior a.nvsb --prior-memory 8 --cameras run.json --split other";
    dive.run(&format!("{encode} --packets packets --overwrite")).ends_with(0);
    // The same input, the same prior, whatever the file is.
    dive.run(&format!("{MAP} --out b.nvsb")).ends_with(0);
    assert_eq!(dive.bytes("a.nvsb"), dive.bytes("b.nvsb"));
}

#[test]
fn borders_show_as_much_as_in_one_piece() {
    let dive = run();
    let map = format!("{MAP} --points points.ply").replace("--iterations 200", "--iterations 400");
    dive.run(&format!("{map} --out parts.nvsb --report parts")).ends_with(0);
    let parts = dive.json("parts/report.json");
    // As many splats. There are more points than that, so training begins with all of them.
    let splats = parts["splats"].as_u64().unwrap();
    let map = map.replace(" --parts 2", "").replace("--splats 600", &format!("--splats {splats}"));
    dive.run(&format!("{map} --out whole.nvsb --report whole")).ends_with(0);
    let whole = psnr(&dive.json("whole/report.json"), "held_out_psnr");
    for key in ["held_out_psnr", "held_out_psnr_at_borders"] {
        assert!(psnr(&parts, key) > whole - 0.7, "{key} of {parts}, in one piece {whole}");
    }
}

#[test]
fn parts_that_are_finished_are_not_trained_again() {
    let dive = run();
    let map = format!("{MAP} --points points.ply");
    let whole = dive.run(&format!("{map} --out whole.ply")).ends_with(0);
    assert!(!whole.stderr.contains("coarse"), "{}", whole.stderr);
    let second = dive.path("cut.ply.parts/part-2.ply.training");
    let mut child = Command::new(env!("CARGO_BIN_EXE_nvsprior"))
        .args(format!("{map} --out cut.ply --save-every 0").split_whitespace())
        .current_dir(dive.path(""))
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    while !second.exists() && child.try_wait().unwrap().is_none() {
        std::thread::sleep(Duration::from_millis(5));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(!dive.path("cut.ply").exists(), "it ended before it was killed");
    let run = dive.run(&format!("{map} --out cut.ply --resume")).ends_with(0);
    run.says("trained before").says("goes on from step");
    assert_eq!(dive.bytes("cut.ply"), dive.bytes("whole.ply"));
    assert!(!dive.path("cut.ply.parts").exists());
}

#[test]
fn what_cannot_be_done_in_parts_is_refused() {
    let dive = run();
    for (args, code, named) in [
        ("--parts 1", 2, "--parts"),
        ("--parts 13", 1, "12 pictures cannot be divided into 13 parts"),
        ("--parts 2 --exposure", 2, "--exposure"),
        ("--parts 2 --correct-poses", 2, "--correct-poses"),
        ("--parts 2 --from prior.ply", 2, "--from"),
    ] {
        let map = MAP.replace("--parts 2", args);
        dive.run(&format!("{map} --out a.nvsb")).ends_with(code).says(named);
    }
    // A file in place of the folder of parts.
    std::fs::write(dive.path("a.nvsb.parts"), "").unwrap();
    dive.run(&format!("{MAP} --out a.nvsb")).ends_with(1).says("a.nvsb.parts");
    assert!(!dive.path("a.nvsb").exists());
}
