//! `encode --learn`: what moves is not learnt, and costs nothing.

use nvsprior::Picture;
use nvsprior_basin::{CAMERA, Conditions, DemoFrame, Run};
use serde_json::Value;

use crate::dive::Dive;

const ENCODE: &str = "encode --prior prior.nvsg --cameras T1/cameras.json --psnr 31 --learn";

fn number(frame: &Value, name: &str) -> f64 {
    frame[name].as_f64().unwrap()
}

/// Frames of run T1, whose scene is as mapped: two episodes.
const MAPPED_FRAMES: usize = 20;

/// Encodes frames of run T1 with learning and without. Returns the bytes of both, updates counted, and of the updates.
fn with_and_without(frames: impl Iterator<Item = DemoFrame>) -> [f64; 3] {
    let dive = Dive::without_frames();
    std::fs::write(dive.path("prior.nvsg"), nvsprior_basin::PRIOR).unwrap();
    nvsprior_basin::write_run(&dive.path("T1"), "T1", nvsprior_basin::CAMERA, frames, |_| {})
        .unwrap();
    let sums = |args: &str| {
        dive.run(&format!("{args} --packets packets --summary summary.json")).ends_with(0);
        let summary = dive.json("summary.json");
        let frames = summary["frames"].as_array().unwrap();
        assert_eq!(frames.len(), MAPPED_FRAMES);
        ["bytes", "update_bytes"].map(|name| frames.iter().map(|f| number(f, name)).sum::<f64>())
    };
    let [[bytes, updates], [without, none]] =
        [ENCODE.to_owned(), ENCODE.replace(" --learn", "")].map(|args| sums(&args));
    assert_eq!(none, 0.0);
    [bytes + updates, without, updates]
}

#[test]
fn moving_light_and_snow_cost_nothing() {
    for strength in [1, 3, 8] {
        let conditions = Conditions {
            caustics: strength as f32 * Conditions::CALM.caustics,
            snow: strength * Conditions::CALM.snow,
            ..Conditions::CALM
        };
        let frames = nvsprior_basin::inspection_run(Run::T1, MAPPED_FRAMES, conditions);
        let [with, without, updates] = with_and_without(frames);
        println!("strength {strength}: {with} bytes, {without} without, updates {updates}");
        assert!(with <= 1.01 * without, "strength {strength}: {with} bytes, {without} without");
    }
}

/// Draws a dark fish with a bright back, which swims through the picture whatever the camera does.
fn swim(picture: &mut Picture, index: usize) {
    let t = index as f32;
    let middle = [20.0 + 14.0 * t, 90.0 + 25.0 * (0.5 * t).sin()];
    for y in 0..CAMERA.height {
        for x in 0..CAMERA.width {
            let (u, v) = ((x as f32 - middle[0]) / 30.0, (y as f32 - middle[1]) / 11.0);
            if u * u + v * v < 1.0 {
                let grey = if v < -0.3 { 190 } else { 25 };
                let at = 3 * (y * CAMERA.width + x) as usize;
                picture.data[at..at + 3].fill(grey);
            }
        }
    }
}

#[test]
fn a_swimming_object_is_not_learnt() {
    let frames = nvsprior_basin::inspection_run(Run::T1, MAPPED_FRAMES, Conditions::CALM);
    let frames = frames.enumerate().map(|(index, mut frame)| {
        swim(&mut frame.picture, index);
        frame
    });
    let [with, without, updates] = with_and_without(frames);
    assert!(without > 60.0 * MAPPED_FRAMES as f64, "{without}: it is to be seen");
    assert_eq!((with, updates), (without, 0.0));
}
