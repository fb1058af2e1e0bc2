//! `nvsprior key-frames`, and what `inspect` and `trim` make of key frames.

use nvsprior::prior::KeyFrames;
use nvsprior::prior::compact::{self, Quantisation};
use nvsprior::{Pose, Prior};

use crate::dive::{Dive, camera_file, view};
use crate::scene::{CAMERA, pose, wall, write_prior};
use crate::study::row;

fn open(dive: &Dive, name: &str) -> Prior {
    Prior::open(&dive.path(name), &Default::default()).unwrap()
}

/// The poses of the camera file, which gives numbers as text.
fn poses(times: &[f64]) -> Vec<Pose> {
    times.iter().map(|t| pose(*t)).collect()
}

fn assert_near(key_frames: &KeyFrames, expected: &[Pose], centre: f64, angle: f64) {
    assert_eq!(key_frames.len(), expected.len());
    for (a, b) in key_frames.poses().iter().zip(expected) {
        assert!((a.centre() - b.centre()).length() <= centre && a.angle_to(b) <= angle);
    }
}

#[test]
fn written_beside_the_prior_and_read_with_it() {
    let dive = Dive::new();
    let id = open(&dive, "prior.ply").id();
    assert_eq!(row(&dive.run("inspect prior.ply").ends_with(0).stdout, "key frames"), "0");
    let command = "key-frames prior.ply --cameras cameras.json --cover 0";
    let text = dive.run(&format!("{command} --distance 0")).ends_with(0).stdout;
    assert_eq!(row(&text, "views"), "4 with poses, 4 show the prior");
    assert!(row(&text, "key frames").starts_with("4, cameras at x "), "{text}");
    assert!(row(&text, "written").starts_with("prior.ply.nvsx, "), "{text}");
    assert_eq!(row(&text, "identity"), format!("{id}, as it was"));
    let prior = open(&dive, "prior.ply");
    assert_eq!(prior.id(), id);
    assert_near(prior.key_frames(), &poses(&[0.0, 1.0, 2.0, 3.0]), 1e-4, 5e-3);
    let text = dive.run("inspect prior.ply").ends_with(0).stdout;
    assert!(row(&text, "key frames").starts_with("4, cameras"), "{text}");
    // By default key frames are 5 % of the distance to the wall apart. The views are 0.055 apart, and the wall is 4
    // away.
    let text = dive.run(command).ends_with(0).stdout;
    let away: f64 = row(&text, "scene").split(' ').next().unwrap().parse().unwrap();
    assert!((3.6..5.0).contains(&away), "{text}");
    assert_eq!(row(&text, "thinned"), format!("to 1, by {:.4} and 10°", 0.05 * away));
    assert_near(open(&dive, "prior.ply").key_frames(), &poses(&[0.0]), 1e-4, 5e-3);
    // From one split, and by angle alone: two views are 0.0078 rad of pitch and yaw apart, 0.41°.
    let narrow = format!("{command} --split dive --spacing 100,0.5");
    dive.run(&narrow).ends_with(0);
    assert_near(open(&dive, "prior.ply").key_frames(), &poses(&[0.0, 2.0]), 1e-4, 5e-3);
    // A broken file is replaced.
    std::fs::write(dive.path("prior.ply.nvsx"), "broken").unwrap();
    dive.run("inspect prior.ply").ends_with(1).says("prior.ply.nvsx: neither");
    dive.run(command).ends_with(0).says("it is written anew");
    assert_eq!(open(&dive, "prior.ply").key_frames().len(), 1);
    let leftover = |name: &str| name.contains("nvsx.");
    let names = std::fs::read_dir(dive.path(".")).unwrap();
    assert!(!names.into_iter().any(|f| leftover(f.unwrap().file_name().to_str().unwrap())));
    // What lies beside another prior of that name is refused, and is gone once the program writes one.
    write_prior(&dive.path("prior.ply"), &wall(2));
    dive.run("inspect prior.ply").ends_with(1).says("prior.ply.nvsx: about prior ");
    dive.run("prior blocks prior.ply --out p.nvsb").ends_with(1);
    std::fs::copy(dive.path("prior.ply.nvsx"), dive.path("small.ply.nvsx")).unwrap();
    write_prior(&dive.path("plain.ply"), &wall(1));
    let trim = "prior trim plain.ply --cameras cameras.json --steps 1 --out small.ply";
    dive.run(trim).ends_with(0);
    assert!(!dive.path("small.ply.nvsx").exists());
}

#[test]
fn added_ones_cover_what_the_views_saw() {
    let dive = Dive::new();
    let mut before = 0.0;
    for (cover, added) in [(4, 0), (20, 16), (60, 56)] {
        let command = "key-frames prior.ply --cameras cameras.json --distance 0 --cover";
        let text = dive.run(&format!("{command} {cover}")).ends_with(0).stdout;
        let covering = row(&text, "covering");
        let (count, share) = covering.split_once(" added, ").unwrap();
        let share: f64 = share.split(' ').next().unwrap().parse().unwrap();
        assert!(count == added.to_string() && share > before && share <= 100.0, "{text}");
        before = share;
        assert!(row(&text, "key frames").starts_with(&format!("{cover}, cameras")), "{text}");
        let prior = open(&dive, "prior.ply");
        assert_eq!(prior.key_frames().len(), cover);
        let first = KeyFrames::new(prior.key_frames().poses()[..4].to_vec()).unwrap();
        assert_near(&first, &poses(&[0.0, 1.0, 2.0, 3.0]), 1e-4, 5e-3);
        // All on the cameras' side of the wall, and they look at it.
        for pose in prior.key_frames().poses() {
            assert!(pose.centre().z < 4.4 && (pose.rotation.conjugate() * glam::DVec3::Z).z > 0.2);
        }
    }
}

#[test]
fn without_cameras_they_stand_in_the_free_volume_if_there_is_one() {
    let dive = Dive::new();
    // In a box around the wall alone there is room in the hollows of its relief.
    let text = dive.run("key-frames prior.ply --cover 10").ends_with(0).stdout;
    assert!(!text.contains("thinned"), "{text}");
    assert!((1..=10).contains(&open(&dive, "prior.ply").key_frames().len()), "{text}");
}

#[test]
fn written_in_place_or_to_copies_of_the_prior() {
    let dive = Dive::new();
    let wall = wall(1);
    let mut bytes = Vec::new();
    let q = Quantisation::default();
    let id = compact::write(wall.splats(), &wall.besides(), &q, &mut bytes).unwrap();
    std::fs::write(dive.path("small.nvsg"), &bytes).unwrap();
    dive.run("prior blocks prior.ply --out site.nvsb").ends_with(0);
    let site = open(&dive, "site.nvsb");
    let options = "--cameras cameras.json --distance 0 --cover 0";
    dive.run(&format!("key-frames prior.ply {options} --out with.nvsg")).ends_with(0);
    dive.run(&format!("key-frames small.nvsg {options} --out copy.nvsg")).ends_with(0);
    assert_eq!(dive.bytes("small.nvsg"), bytes);
    dive.run(&format!("key-frames small.nvsg {options}")).ends_with(0);
    dive.run(&format!("key-frames site.nvsb {options}")).ends_with(0);
    let times = [0.0, 1.0, 2.0, 3.0];
    let small = compact::read(&bytes).unwrap().splats;
    for (name, id, splats) in [
        ("with.nvsg", wall.id(), wall.splats()),
        ("small.nvsg", id, &small),
        ("site.nvsb", site.id(), site.splats()),
    ] {
        let prior = open(&dive, name);
        assert_eq!((prior.id(), prior.splats()), (id, splats), "{name}");
        assert_near(prior.key_frames(), &poses(&times), 5e-3, 5e-3);
    }
    assert_eq!(dive.bytes("small.nvsg"), dive.bytes("copy.nvsg"));
    let beside = std::fs::read_dir(dive.path(".")).unwrap();
    let names = beside.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let beside: Vec<_> =
        names.filter(|name| name.contains(".nvsg.") || name.contains("nvsb.")).collect();
    assert!(beside.is_empty(), "{beside:?}");
}

#[test]
fn trim_carries_them_over() {
    let dive = Dive::new();
    dive.run("key-frames prior.ply --cameras cameras.json --distance 0 --cover 0").ends_with(0);
    let trim = "prior trim prior.ply --cameras cameras.json --steps 1";
    for (name, error) in [("small.ply", 5e-3), ("small.nvsg", 5e-3)] {
        let text = dive.run(&format!("{trim} --out {name}")).ends_with(0).stdout;
        assert_eq!(row(&text, "key frames"), "4");
        let small = open(&dive, name);
        assert_near(small.key_frames(), &poses(&[0.0, 1.0, 2.0, 3.0]), error, error);
    }
}

#[test]
fn refusals_name_what_is_wrong() {
    let dive = Dive::new();
    let command = "key-frames prior.ply --cameras cameras.json";
    // A camera that looks away from the wall.
    let away = Pose::from_wxyz([0.0, 0.0, 1.0, 0.0], [0.0; 3]).unwrap();
    dive.write_json("away.json", &camera_file(&CAMERA, vec![view("a.png", 0, "a", &away)]));
    for (args, code, named) in [
        ("key-frames prior.ply --split dive", 2, "--cameras"),
        ("key-frames prior.ply --distance 1", 2, "--cameras"),
        ("key-frames prior.ply --cover 0", 1, "prior.ply: --cover 0 and no --cameras"),
        (&format!("{command} --cover 65537"), 2, "--cover"),
        (&format!("{command} --distance=-1"), 2, "not negative"),
        (&format!("{command} --spacing 1,nan"), 2, "--spacing"),
        (&format!("{command} --split night"), 1, "\"night\"; there are: dive, survey"),
        (&format!("{command} --out a.ply"), 1, "a.ply: a copy of a PLY"),
        (&format!("{command} --out a.nvsb"), 1, "ends in .nvsg"),
        (&format!("{command} --out none/a.nvsg"), 1, "none/a.nvsg"),
        ("key-frames none.ply --cameras cameras.json", 1, "none.ply"),
        ("key-frames cameras.json --cameras cameras.json", 1, "cameras.json: neither a PLY"),
        ("key-frames prior.ply --cameras none.json", 1, "none.json"),
        ("key-frames prior.ply --cameras away.json", 1, "no view of away.json shows a splat"),
    ] {
        dive.run(args).ends_with(code).says(named);
        assert!(!dive.path("prior.ply.nvsx").exists(), "{args}");
    }
}
