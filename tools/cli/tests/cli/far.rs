//! Commands on a scene far from the origin of its coordinates, as one in UTM.

use glam::DVec3;
use nvsprior::prior::Splats;
use nvsprior::{Pose, Prior, RenderOptions};

use crate::dive::{Dive, FRAMES, camera_file, name, view};
use crate::scene::{CAMERA, pose, pose_error, wall, write_prior};
use crate::study::row;

const PLACE: DVec3 = DVec3::new(512_345.25, 5_932_101.5, -37.125);

fn there(t: usize) -> Pose {
    pose(t as f64).absolute_from(PLACE)
}

/// A dive with `far.ply` and `far.json`, both there.
fn far_dive() -> Dive {
    let dive = Dive::new();
    let splats = Splats { origin: PLACE.into(), ..wall(1).splats().clone() };
    write_prior(&dive.path("far.ply"), &Prior::from_splats(splats, RenderOptions::INRIA).unwrap());
    let split = |t| if t < FRAMES { "dive" } else { "survey" };
    let images = (0..=FRAMES).map(|t| view(&name(t), t, split(t), &there(t)));
    dive.write_json("far.json", &camera_file(&CAMERA, images.collect()));
    dive
}

/// How far the poses of a track are off, pixels.
fn worst(dive: &Dive, track: &str) -> f64 {
    let known = nvsprior_inputs::frame_file::read_known(&dive.path(track)).unwrap();
    assert_eq!(known.len(), FRAMES);
    let found = |t: usize| {
        let of = |(file, _): &(&String, _)| file.contains(&t.to_string());
        known.iter().find(of).unwrap().1.hint.unwrap().pose.relative_to(PLACE)
    };
    (0..FRAMES).map(|t| pose_error(&found(t), &pose(t as f64))).fold(0.0, f64::max)
}

#[test]
fn poses_go_in_and_come_out_as_the_camera_file_has_them() {
    let dive = far_dive();
    let stated = row(&dive.run("inspect far.ply").ends_with(0).stdout, "origin").to_owned();
    assert_eq!(stated, "512345.25, 5932101.5, -37.125");
    let input = "--cameras far.json --split dive --packets packets --track vehicle.csv";
    dive.run(&format!("encode --prior far.ply {input}")).ends_with(0);
    dive.run("decode --prior far.ply --packets packets --pictures out --track topside.csv")
        .ends_with(0);
    for track in ["vehicle.csv", "topside.csv"] {
        let off = worst(&dive, track);
        assert!(off < 0.5, "{track}: {off} pixels");
    }
    // The same pictures, packets and key frames as near to the origin.
    dive.run("encode --prior prior.ply --cameras cameras.json --split dive --packets near")
        .ends_with(0);
    for t in 0..FRAMES {
        let [far, near] =
            ["packets", "near"].map(|folder| dive.bytes(&format!("{folder}/{t}.nvsp")));
        assert!(far.len().abs_diff(near.len()) < 20, "{} {}", far.len(), near.len());
    }
    let frame = format!("--frame {}", name(1));
    for (prior, cameras) in [("far", "far"), ("prior", "cameras")] {
        let out = format!("--out {prior}.png");
        dive.run(&format!("render --prior {prior}.ply --cameras {cameras}.json {frame} {out}"))
            .ends_with(0);
        let trim = format!("prior trim {prior}.ply --cameras {cameras}.json --steps 1");
        dive.run(&format!("{trim} --out {prior}.nvsg")).ends_with(0);
        let key_frames = format!("prior key-frames {prior}.nvsg --cameras {cameras}.json");
        dive.run(&format!("{key_frames} --spacing 0 --cover 0")).ends_with(0);
    }
    assert!(dive.picture("far.png").psnr(&dive.picture("prior.png")) > 60.0);
    let [far, near] = ["far.nvsg", "prior.nvsg"]
        .map(|name| Prior::open(&dive.path(name), &Default::default()).unwrap());
    assert_eq!((far.origin(), near.origin()), (PLACE, DVec3::ZERO));
    assert_eq!(far.splats().positions, near.splats().positions);
    for (a, b) in far.key_frames().poses().iter().zip(near.key_frames().poses()) {
        assert!(pose_error(a, b) < 0.5, "{a:?} {b:?}");
    }
}

#[test]
fn a_map_of_far_cameras_counts_from_near_them() {
    let dive = far_dive();
    let map = "map --cameras far.json --split dive --splats 400 --iterations 60";
    let run = dive.run(&format!("{map} --undistorted flat --out far.nvsg")).ends_with(0);
    let run = run.says("far from the origin of its coordinates");
    let prior = Prior::open(&dive.path("far.nvsg"), &Default::default()).unwrap();
    assert!((prior.origin() - PLACE).length() < 10.0, "{}\n{}", prior.origin(), run.stderr);
    assert!(!prior.key_frames().is_empty());
    let spread = prior.coordinate_frame().spread;
    assert!(spread < 100.0, "{spread}");
    // What it has written without distortion is where the cameras were.
    let flat = dive.json("flat/cameras.json");
    let written = &flat["images"][0]["tvec"];
    assert!(written[1].as_f64().unwrap().abs() > 1e6, "{written}");
    let input = "--cameras flat/cameras.json --split dive --packets packets --track vehicle.csv";
    dive.run(&format!("encode --prior far.nvsg {input}")).ends_with(0);
    // Going on keeps the origin.
    let on = "--cameras far.json --splats 400 --iterations 20";
    dive.run(&format!("map --from far.nvsg {on} --out next.nvsg")).ends_with(0);
    let next = Prior::open(&dive.path("next.nvsg"), &Default::default()).unwrap();
    assert_eq!(next.origin(), prior.origin());
}
