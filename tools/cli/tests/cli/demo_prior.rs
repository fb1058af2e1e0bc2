//! The demo's prior, as it comes with the program, against the basin's runs.

use nvsprior::render::Plan;
use nvsprior::{Encoder, EncoderOptions, Picture, Prior};
use nvsprior_basin::{CAMERA, Conditions, Run, inspection_run};

use crate::common::engine;

/// A new object and a safety line come into view: the search must not follow them away from the scene.
#[test]
fn a_new_object_does_not_draw_the_search_away() {
    let engine = engine();
    let prior =
        Prior::from_bytes(nvsprior_basin::PRIOR, "prior.nvsg", &Default::default()).unwrap();
    let scene = engine.upload(&prior).unwrap();
    let mut renderer = engine.renderer(&scene, &CAMERA, Plan::picture()).unwrap();
    let options = EncoderOptions { rate: None, ..EncoderOptions::default() };
    let mut encoder = Encoder::new(&engine, &scene, &CAMERA, options).unwrap();
    let mut render = Picture::new(CAMERA.width, CAMERA.height);
    for (index, frame) in inspection_run(Run::T2, 5, Conditions::BASIN).enumerate() {
        renderer.picture(&frame.pose, &mut render).unwrap();
        let at_the_true_pose = render.psnr(&frame.picture);
        let stats =
            encoder.encode(&frame.picture, (index == 0).then_some(frame.pose)).unwrap().stats;
        assert!(
            stats.render_psnr > at_the_true_pose - 0.3,
            "frame {index}: {} dB, {at_the_true_pose} dB at the true pose",
            stats.render_psnr
        );
    }
}
