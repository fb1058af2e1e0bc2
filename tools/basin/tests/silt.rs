//! Silt comes over half of the picture, then over all of it, and goes in the same way.

use nvsprior::random::Random;
use nvsprior::tracking::{FrameInfo, Hint};
use nvsprior::{Encoder, EncoderOptions, Engine, Picture, Prior};
use nvsprior_basin::{CAMERA, Conditions, PRIOR, Run, inspection_run};

const RATE: f64 = 3.0;
/// Frames of T2 between which silt comes and goes.
const FIRST: usize = 16;
const COMES: usize = 18;
const GOES: usize = 25;
const LAST: usize = 27;
/// The box and the line, which the prior does not know, move a pose by less; in metres.
const NEAR: f64 = 0.1;

/// Silt over the first rows of a picture.
fn silted(mut picture: Picture, rows: u32, random: &mut Random) -> Picture {
    let covered = 3 * (picture.width * rows) as usize;
    picture.data[..covered].fill_with(|| (120.0 + random.within(-4.0, 4.0)) as u8);
    picture
}

/// The frame at which silt comes is certain by what is left of it. That must not make a wrong pose acceptable once it
/// goes, metres further on.
#[test]
fn a_pose_that_is_called_certain_after_silt_is_right() {
    let engine = Engine::new(&Default::default()).unwrap();
    let prior = Prior::from_bytes(PRIOR, "the demo's prior", &Default::default()).unwrap();
    let scene = engine.upload(&prior).unwrap();
    let options = EncoderOptions { threshold: 1e-2, rate: None, ..EncoderOptions::default() };
    let mut encoder = Encoder::new(&engine, &scene, &CAMERA, options).unwrap();
    let mut random = Random::new(3);
    let mut certain = Vec::new();
    let frames = inspection_run(Run::T2, LAST + 1, Conditions::CALM);
    for (number, frame) in frames.enumerate().skip(FIRST) {
        let rows = match number {
            COMES | GOES => CAMERA.height / 2,
            number if (COMES..GOES).contains(&number) => CAMERA.height,
            _ => 0,
        };
        let hint = (number == FIRST).then(|| Hint::of(frame.pose));
        let time = Some(number as f64 / RATE);
        let picture = silted(frame.picture, rows, &mut random);
        let encoded =
            encoder.encode(&picture, FrameInfo { time, hint, ..Default::default() }).unwrap();
        if encoded.stats.certain {
            let off = (encoded.pose.centre() - frame.pose.centre()).length();
            assert!(off < NEAR, "frame {number} is called certain, and off by {off:.2} m");
            certain.push(number);
        }
    }
    assert!(certain.starts_with(&[FIRST, FIRST + 1, COMES]), "{certain:?}");
    assert!(certain.ends_with(&[LAST]), "it is found again: {certain:?}");
}
