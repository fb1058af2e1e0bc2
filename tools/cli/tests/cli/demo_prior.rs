//! The demo: its prior, as it comes with the program, against the basin's runs; and the site without one.

use nvsprior::render::Plan;
use nvsprior::{Encoder, EncoderOptions, Picture, Prior};
use nvsprior_basin::{CAMERA, Conditions, Run, inspection_run};

use crate::common::engine;
use crate::dive::Dive;

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
    for (index, frame) in inspection_run(Run::T2, 5, Conditions::CALM).enumerate() {
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

#[test]
fn the_quay_is_drawn_and_not_encoded() {
    let dive = Dive::new();
    dive.run("demo --site quay --frames 2 --out quay").ends_with(0);
    let folder = dive.path("quay");
    let cameras = std::fs::read_to_string(folder.join("T3/cameras.json")).unwrap();
    assert_eq!(cameras.matches(".png").count(), 2);
    assert_eq!(std::fs::read_dir(folder.join("T3/T3")).unwrap().count(), 2);
    assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 1);
}
