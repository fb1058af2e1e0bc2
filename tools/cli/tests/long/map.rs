//! `nvsprior map` on very many pictures, and on a run along the line of sight.

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
    dive.run("demo --site tower --mapping-run --course approach --width 160 --out .").ends_with(0);
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
    // What poses are worth can be measured against it.
    dive.run("demo --run T7 --draw-only --frames 3 --rate 0.1 --width 160 --out .").ends_with(0);
    let cameras = "--cameras T7/cameras.json --width 160 --poses-starts --report poses";
    let poses = format!("bench --poses --prior a.nvsg {cameras}");
    let told = dive.run(&poses).ends_with(0).stdout;
    assert!(told.contains("frames certain; position known in"), "{told}");
    let summary = dive.json("poses/poses.json");
    assert_eq!(
        (&summary[0]["frames"], summary[0]["axes"].as_array().unwrap().len()),
        (&3.into(), 6)
    );
    assert!(!dive.bytes("poses/poses.csv").is_empty() && !dive.bytes("poses/poses.svg").is_empty());
}
