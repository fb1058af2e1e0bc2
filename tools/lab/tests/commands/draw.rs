//! `nvsprior-lab draw`: sites and runs.

use std::path::Path;

use crate::dive::Dive;

#[test]
fn the_quay_is_drawn() {
    let dive = Dive::new();
    dive.run("draw --site quay --frames 2 --out quay").ends_with(0);
    let folder = dive.path("quay");
    let cameras = std::fs::read_to_string(folder.join("T3/cameras.json")).unwrap();
    assert_eq!(cameras.matches(".png").count(), 2);
    assert_eq!(std::fs::read_dir(folder.join("T3/T3")).unwrap().count(), 2);
    assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 1);
}

#[test]
fn the_tower_is_drawn_by_what_the_vehicle_carries() {
    let dive = Dive::new();
    let draw = |args: &str| {
        dive.run(&format!("draw --run T7 --frames 1 --width 160 {args}")).ends_with(0);
    };
    draw("--out narrow");
    draw("--lens 80 --out wide");
    draw("--camera 2 --out second");
    draw("--lamps left --out left");
    let focal = |run: &str| dive.json(&format!("{run}/T7/cameras.json"))["fx"].as_f64().unwrap();
    let of = |degrees: f64| 80.0 / (degrees / 2.0).to_radians().tan();
    assert!((focal("narrow") - of(33.0)).abs() < 1e-3 && (focal("wide") - of(80.0)).abs() < 1e-3);
    let place = |run: &str| {
        let listed = dive.json(&format!("{run}/T7/cameras.json"));
        listed["images"][0]["tvec"][0].as_f64().unwrap()
    };
    assert!((place("narrow") - place("second") - 0.2).abs() < 0.05);
    let picture = |run: &str| dive.bytes(&format!("{run}/T7/T7/0001.png"));
    assert_ne!(picture("narrow"), picture("left"));
}

#[test]
fn the_tower_is_mapped_by_course() {
    let dive = Dive::new();
    dive.run("draw --site tower --mapping-run --course approach --width 160 --out .").ends_with(0);
    let listed = dive.json("M4/cameras.json");
    let images = listed["images"].as_array().unwrap();
    assert_eq!(images.len(), 24);
    assert!(
        images.iter().all(|image| dive.path("M4").join(image["file"].as_str().unwrap()).exists())
    );
}

#[test]
fn a_dive_is_drawn_weeks_later() {
    let dive = Dive::without_frames();
    let draw = |args: &str| dive.run(&format!("draw --frames 1 --width 160 {args}")).ends_with(0);
    draw("--run T4 --out aged");
    draw("--run T4 --age 0 --dive 2 --out mapped");
    let picture = |run: &str| dive.bytes(&format!("{run}/T4/T4/0001.png"));
    assert_ne!(picture("aged"), picture("mapped"));
}

#[test]
fn a_survey_of_the_quay_becomes_a_video() {
    let dive = Dive::without_frames();
    let run = dive.run("draw --video quay.mp4 --seconds 0.25 --fps 4").ends_with(0);
    assert!(run.stdout.contains("--camera OPENCV:760,760,644,356,-0.12,"), "{}", run.stdout);
    let csv = std::fs::read_to_string(dive.path("quay.mp4.csv")).unwrap();
    assert_eq!(csv.lines().count(), 2);
    assert!(csv.lines().nth(1).unwrap().starts_with("000000,0,"), "{csv}");
    assert!(std::fs::metadata(dive.path("quay.mp4")).unwrap().len() > 10_000);
    assert!(!Path::new(&dive.path("quay.mp4.drawn")).exists());
    let refused = dive.run("draw --video none/quay.mp4").ends_with(1);
    refused.says("--video none/quay.mp4: cannot be written");
}

#[test]
fn wrong_usage_ends_with_2() {
    let dive = Dive::without_frames();
    for (args, named) in [
        ("--run T9", "there are: T1, T2, T3, T4, T5"),
        ("--run T4 --site quay", "not a run of that --site"),
        ("--run T2 --age 8", "only the scene of T4 and T5 ages"),
        ("--run T4 --age -1", "between 0 and 520 weeks"),
        ("--age 8", "--run"),
        ("--run T4 --dive 6", "1..=5"),
        ("--run T1 --width 100", "160..=4096"),
        ("--video quay.mp4 --width 640", "--width"),
        ("--run T2 --lens 80", "--lens: only --site tower has it"),
        ("--site quay --camera 2", "--camera: only --site tower has it"),
        ("--mapping-run --lamps left", "--lamps: only --site tower has it"),
        ("--site row --mapping-run --course arcs", "--course: only --site tower has it"),
        ("--site tower --course arcs", "--mapping-run"),
        ("--run T7 --lens 10", "between 20 and 100 degrees"),
        ("--run T4 --mapping-run", "--mapping-run"),
    ] {
        dive.run(&format!("draw {args}")).ends_with(2).says(named);
    }
}
