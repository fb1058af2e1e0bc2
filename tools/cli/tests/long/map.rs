//! `nvsprior map` on very many pictures, and on a run along the line of sight.

use nvsprior_basin::{Conditions, Course, MappingRun, Rig, Site, mapping_run_by, write_run};

use crate::dive::{Dive, camera_file, view};
use crate::scene::{CAMERA, pose};

#[test]
fn ten_thousand_pictures_start_with_their_memory_stated() {
    let camera = CAMERA.resized(32, 18);
    let files: Vec<String> = (0..10_000).map(|t| format!("small/{}.png", t % 4)).collect();
    let dive = Dive::new();
    let views = files.iter().enumerate();
    let views = views.map(|(t, file)| view(file, t, "dive", &pose((t % 4) as f64)));
    dive.write_json("cameras.json", &camera_file(&camera, views.collect()));
    std::fs::create_dir(dive.path("small")).unwrap();
    for t in 0..4 {
        let image = image::open(dive.path(&format!("images/{t}.png"))).unwrap();
        image.thumbnail_exact(32, 18).save(dive.path(&format!("small/{t}.png"))).unwrap();
    }
    let map = "map --cameras cameras.json --split dive --splats 300 --iterations 30";
    let run = dive.run(&format!("{map} --held-out 100 --rehearsal 0 --out a.ply")).ends_with(0);
    run.says("9900 pictures of 32×18, 100 held out")
        .says("MB of host memory")
        .says("device memory");
}

/// An approach alone does not tell depths: `map` says so before the dive, and the prior keeps it.
#[test]
fn a_run_along_the_line_of_sight_is_told_what_it_is_worth() {
    let dive = Dive::new();
    let (rig, site) = (Rig::default(), Site::Tower);
    let (camera, run) = (rig.pinhole(160), MappingRun { site, course: Course::Approach, rig });
    let frames = mapping_run_by(camera, run, Conditions::CALM);
    write_run(&dive.path("M4"), "M4", camera, frames, |_| ()).unwrap();
    let map = "map --cameras M4/cameras.json --width 160 --splats 4000 --iterations 1000";
    let run = dive.run(&format!("{map} --out a.nvsg --report report")).ends_with(0);
    let run = run.says("this run does not determine where a camera is");
    for told in ["poses of a dive beside it: off by", "the picture to take next: fly an arc"] {
        assert!(run.stdout.contains(told), "{}", run.stdout);
    }
    let report = dive.json("report/report.json");
    let expected = &report["expected_pose_error"];
    for name in ["position", "position_90", "rotation_degrees", "doubt", "seconds"] {
        assert!(expected[name].as_f64().is_some_and(|v| v > 0.0), "{name}: {expected}");
    }
    assert!(report["parallax"]["from_two_sides"].as_f64() < Some(0.3), "{report}");
    let inspected = dive.run("inspect a.nvsg").ends_with(0).stdout;
    assert!(inspected.contains("times what a picture alone tells"), "{inspected}");
}
