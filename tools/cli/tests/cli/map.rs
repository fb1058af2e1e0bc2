//! `nvsprior map`: a prior from posed pictures.

use std::process::{Command, Stdio};

use nvsprior::Prior;
use serde_json::{Value, json};

use crate::dive::Dive;
use crate::scene::CAMERA;
use crate::study::row;

const MAP: &str = "map --cameras cameras.json --split dive --splats 400 --iterations 60";

#[test]
fn a_prior_is_trained_and_encodes_the_dive() {
    let dive = Dive::new();
    dive.run(&format!("{MAP} --out a.ply --report report")).ends_with(0).says("survey");
    let report = dive.json("report/report.json");
    assert_eq!(report["iterations"], 60);
    assert_eq!(report["pictures"][0]["name"], "images/3.png");
    for key in ["held_out_psnr", "seconds", "cpu_seconds", "iteration_in_forward_renders", "splats"]
    {
        assert!(report[key].as_f64().is_some_and(|v| v > 0.0), "{key} of {report}");
    }
    assert!(report["parallax"]["median_degrees"].is_number(), "{report}");
    assert_eq!(report["expected_pose_error"], Value::Null, "so few pictures have no stretches");
    for file in ["curve.csv", "curve.svg", "preview.png", "parallax.png"] {
        assert!(!dive.bytes(&format!("report/{file}")).is_empty(), "{file}");
    }
    let prior = Prior::open(&dive.path("a.ply"), &Default::default()).unwrap();
    assert_eq!(report["splats"], prior.len());
    assert!(!prior.key_frames().is_empty());
    let encode =
        "encode --prior a.ply --cameras cameras.json --split dive --packets packets --overwrite";
    dive.run(encode).ends_with(0);
    assert!(!dive.path("a.ply.training").exists());
    // A .ply has no place for its doubt, which is added beside it.
    assert!(!dive.path("a.ply.nvsx").exists());
    let decode = "decode --prior a.ply --packets packets --overwrite --frames out --doubt doubt";
    dive.run(decode).ends_with(0).says("a.ply: without doubt").says("`nvsprior prior doubt`");
    let cameras = "--cameras cameras.json --split dive";
    let check = "--check cameras.json dive";
    let run = dive.run(&format!("prior doubt --prior a.ply {cameras} {check}")).ends_with(0);
    assert!(run.stdout.contains("ranked right"), "{}", run.stdout);
    assert!(dive.path("a.ply.nvsx").exists());
    dive.run(decode).ends_with(0);
    let doubt = image::open(dive.path("doubt/0.png")).unwrap().to_luma8();
    assert!(doubt.pixels().all(|pixel| pixel.0[0] < 3));
    // The same input, the same bytes.
    dive.run(&format!("{MAP} --out b.ply")).ends_with(0);
    assert_eq!(dive.bytes("a.ply"), dive.bytes("b.ply"));
    dive.run(&format!("{MAP} --out b.nvsg --minutes 0.01").replace("--iterations 60", ""))
        .ends_with(0);
    // One file holds all.
    let own = Prior::open(&dive.path("b.nvsg"), &Default::default()).unwrap();
    let extras = own.extras();
    assert_eq!(extras.doubt.as_ref().map(Vec::len), Some(own.len()));
    assert!(!extras.key_frames.is_empty() && extras.lens.is_some());
    assert_eq!(extras.lens.unwrap().size(), (CAMERA.width, CAMERA.height));
    let names = std::fs::read_dir(dive.path(".")).unwrap();
    let names = names.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    assert_eq!(names.filter(|name| name.starts_with("b.nvsg")).count(), 1);
}

#[test]
fn one_prior_is_trained_for_several_sizes() {
    let dive = Dive::new();
    let cameras = dive.json("cameras.json");
    let width = cameras["width"].as_u64().unwrap();
    let half = width / 2;
    dive.run(&format!("{MAP} --width {half},{width} --out both.nvsg --report report")).ends_with(0);
    let report = dive.json("report/report.json");
    let splits = report["held_out_psnr_by_split"].as_object().unwrap();
    let psnr = |split: &str| splits[split].as_f64().unwrap();
    assert!(psnr("survey") > 0.0 && psnr(&format!("survey at {half}")) > 0.0, "{report}");
    let prior = Prior::open(&dive.path("both.nvsg"), &Default::default()).unwrap();
    let focal = cameras["fx"].as_f64().unwrap() as f32;
    assert_eq!(prior.options().trained_focal, Some(focal));
    let other = dive.run("inspect both.nvsg --trained-focal 123.5").ends_with(0).stdout;
    assert!(other.contains("123.5 pixels"), "{other}");
    // It is another prior.
    assert!(!other.contains(&prior.id().to_string()), "{other}");
    let odd = format!("{MAP} --width {},{width} --out odd.nvsg", half + 1);
    dive.run(&odd).ends_with(2).says(&format!("no multiple of {}", half + 1));
}

#[test]
fn pictures_of_a_lens_are_written_without_distortion_for_the_other_commands() {
    let dive = Dive::new();
    let cameras = dive.json("cameras.json");
    let number = |key: &str| cameras[key].as_f64().unwrap();
    let [width, height, fx, cx, cy] = ["width", "height", "fx", "cx", "cy"].map(number);
    let camera = format!("1 SIMPLE_RADIAL {width} {height} {fx} {cx} {cy} -0.1\n");
    let image = |(i, image): (usize, &Value)| {
        let numbers = ["qvec", "tvec"].map(|key| image[key].as_array().unwrap());
        let numbers: Vec<_> = numbers.into_iter().flatten().map(Value::to_string).collect();
        format!("{i} {} 1 {}\n\n", numbers.join(" "), image["file"].as_str().unwrap())
    };
    let images: String =
        cameras["images"].as_array().unwrap().iter().enumerate().map(image).collect();
    std::fs::create_dir(dive.path("model")).unwrap();
    for (name, text) in [("cameras", camera), ("images", images), ("points3D", String::new())] {
        std::fs::write(dive.path(&format!("model/{name}.txt")), text).unwrap();
    }
    let map = "map --cameras model --pictures . --splats 300 --iterations 30 --held-out 3";
    dive.run(&format!("{map} --undistorted flat --out a.ply")).ends_with(0);
    assert_ne!(dive.bytes("flat/images/1.png"), dive.bytes("images/1.png"));
    for split in ["train", "held-out"] {
        let cameras = format!("--cameras flat/cameras.json --split {split}");
        let out = format!("--packets {split} --summary {split}.json");
        dive.run(&format!("encode --prior a.ply {cameras} {out}")).ends_with(0);
    }
    dive.run(&format!("{map} --undistorted a.ply --out b.ply")).ends_with(1).says("--undistorted");
}

/// All pictures of the camera file, of which the second one is held out.
const HELD_OUT: &str = "map --cameras cameras.json --held-out 3 --splats 400 --iterations 60";

#[test]
fn what_is_held_out_is_trained_on_in_the_end() {
    let dive = Dive::new();
    let run = dive.run(&format!("{HELD_OUT} --out a.ply --report report")).ends_with(0);
    run.says("step 51: the rest is with all pictures").says("step 51, ");
    let report = dive.json("report/report.json");
    assert_eq!((&report["held_out_step"], &report["iterations"]), (&json!(51), &json!(60)));
    assert_eq!(report["pictures"].as_array().unwrap().len(), 1, "{report}");
    let curve = String::from_utf8(dive.bytes("report/curve.csv")).unwrap();
    assert!(curve.lines().last().unwrap().starts_with("51,"), "{curve}");
}

#[test]
fn a_killed_training_goes_on_to_the_same_prior() {
    for map in [MAP, HELD_OUT] {
        goes_on_to_the_same_prior(map);
    }
}

fn goes_on_to_the_same_prior(map: &str) {
    let dive = Dive::new();
    dive.run(&format!("{map} --out whole.ply")).ends_with(0);
    let saved = dive.path("cut.ply.training");
    let mut child = Command::new(env!("CARGO_BIN_EXE_nvsprior"))
        .args(format!("{map} --out cut.ply --save-every 0").split_whitespace())
        .current_dir(dive.path(""))
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    while !saved.exists() && child.try_wait().unwrap().is_none() {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    if !dive.path("cut.ply").exists() {
        dive.run(&format!("{map} --out cut.ply --resume")).ends_with(0).says("goes on from step");
    }
    assert_eq!(dive.bytes("cut.ply"), dive.bytes("whole.ply"));
    assert!(!saved.exists());
}

#[test]
fn wrong_arguments_and_files_are_named_before_any_work() {
    let dive = Dive::new();
    for (args, code, named) in [
        (format!("{MAP} --out a.txt"), 1, "a.txt"),
        (format!("{MAP} --out none/a.ply"), 1, "none/a.ply"),
        (format!("{MAP} --out a.ply --minutes 1"), 2, "--minutes"),
        (format!("{MAP} --out a.ply --sh-degree 4"), 2, "--sh-degree"),
        (MAP.replace("dive", "other") + " --out a.ply", 1, "other"),
        (MAP.replace("cameras.json", "none.json") + " --out a.ply", 1, "none.json"),
        (format!("{MAP} --out a.ply --points none.ply"), 1, "none.ply"),
    ] {
        dive.run(&args).ends_with(code).says(named);
    }
    std::fs::write(dive.path("a.ply.training"), b"something else").unwrap();
    dive.run(&format!("{MAP} --out a.ply --resume")).ends_with(1).says("a.ply.training");
    std::fs::write(dive.path("images/1.png"), b"no picture").unwrap();
    dive.run(&format!("{MAP} --out a.ply")).ends_with(1).says("images/1.png");
    std::fs::remove_file(dive.path("images/1.png")).unwrap();
    dive.run(&format!("{MAP} --out a.ply")).ends_with(1).says("images/1.png");
    let mut cameras = dive.json("cameras.json");
    cameras["images"][2]["tvec"] = json!(["nan", 0.0, 0.0]);
    dive.write_json("cameras.json", &cameras);
    dive.run(&format!("{MAP} --out a.ply")).ends_with(1).says("cameras.json");
    assert!(!dive.path("a.ply").exists());
}

const FROM: &str = "map --from prior.ply --cameras cameras.json --split dive --iterations 60";

#[test]
fn a_prior_goes_on_with_the_pictures_of_a_later_dive() {
    let dive = Dive::new();
    let before = Prior::open(&dive.path("prior.ply"), &Default::default()).unwrap();
    let run = dive.run(&format!("{FROM} --out a.nvsg --report report")).ends_with(0);
    run.says("a prior to go on with");
    let report = dive.json("report/report.json");
    assert_eq!(report["iterations"], 60);
    // As many steps from nothing lead nowhere near.
    let new = MAP.replace("--splats 400", "--splats 4800");
    dive.run(&format!("{new} --out new.ply --report new")).ends_with(0);
    let nothing = dive.json("new/report.json");
    let psnr = |report: &Value| report["held_out_psnr"].as_f64().unwrap();
    assert!(psnr(&report) > psnr(&nothing) + 5.0, "{report}, from nothing {nothing}");
    let after = Prior::open(&dive.path("a.nvsg"), &Default::default()).unwrap();
    assert_eq!(after.options(), before.options());
    assert_eq!(after.splats().sh_degree, before.splats().sh_degree);
    assert!((before.len()..=before.len() * 11 / 10).contains(&after.len()), "{}", after.len());
    assert!(!after.key_frames().is_empty());
    // The same input, the same bytes. It has key frames now, of which views are remembered.
    dive.run(&format!("{FROM} --out b.nvsg")).ends_with(0);
    assert_eq!(dive.bytes("a.nvsg"), dive.bytes("b.nvsg"));
    let second = FROM.replace("prior.ply", "a.nvsg");
    dive.run(&format!("{second} --out c.nvsg --dive second")).ends_with(0);
    let text = dive.run("inspect c.nvsg").ends_with(0).stdout;
    assert!(row(&text, "dive 1").starts_with("trained on 3 pictures"), "{text}");
    assert!(row(&text, "dive second").starts_with("trained on 3 pictures"), "{text}");
    // Earlier pictures in place of its views.
    dive.run(&format!("{FROM} --earlier cameras.json --out d.nvsg")).ends_with(0);
    assert_ne!(dive.bytes("a.nvsg"), dive.bytes("d.nvsg"));
}

#[test]
fn what_does_not_go_with_a_prior_is_refused() {
    let dive = Dive::new();
    for (args, code, named) in [
        ("--resume", 2, "--resume"),
        ("--sh-degree 2", 2, "--sh-degree"),
        ("--points points.ply", 2, "--points"),
        ("--white-balance", 2, "--white-balance"),
        ("--clahe", 2, "--clahe"),
        ("--splats 3", 1, "option splats = 3 is out of range: at least as many as the prior has"),
        ("--earlier none.json", 1, "none.json"),
        ("--dive a,b", 2, "--dive"),
    ] {
        dive.run(&format!("{FROM} --out a.ply {args}")).ends_with(code).says(named);
    }
    dive.run(&format!("{MAP} --earlier cameras.json --out a.ply")).ends_with(2).says("--from");
    let absent = FROM.replace("prior.ply", "none.ply");
    dive.run(&format!("{absent} --out a.ply")).ends_with(1).says("none.ply");
    assert!(!dive.path("a.ply").exists());
}
