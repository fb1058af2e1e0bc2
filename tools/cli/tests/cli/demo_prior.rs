//! The demo: its prior, as it comes with the program, against the basin's runs; and runs that are only drawn.

use nvsprior::render::Plan;
use nvsprior::{Encoder, EncoderOptions, Picture, Prior};
use nvsprior_basin::{CAMERA, Conditions, Run, inspection_run};

use crate::common::engine;
use crate::dive::Dive;

/// A new object and a safety line come into view: the search must not follow them away from the scene.
#[test]
fn a_new_object_does_not_draw_the_search_away() {
    follows(Run::T2);
}

/// Neither must it follow a chain, or what has grown.
#[test]
fn weeks_of_growth_do_not_draw_the_search_away() {
    follows(Run::T4);
}

/// Checks that the search finds poses at which the render is as good as at the true ones.
fn follows(run: Run) {
    let engine = engine();
    let prior =
        Prior::from_bytes(nvsprior_basin::PRIOR, "prior.nvsg", &Default::default()).unwrap();
    let scene = engine.upload(&prior).unwrap();
    let mut renderer = engine.renderer(&scene, &CAMERA, Plan::picture()).unwrap();
    let options = EncoderOptions { rate: None, ..EncoderOptions::default() };
    let mut encoder = Encoder::new(&engine, &scene, &CAMERA, options).unwrap();
    let mut render = Picture::new(CAMERA.width, CAMERA.height);
    for (index, frame) in inspection_run(run, 5, Conditions::CALM).enumerate() {
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
fn the_prior_that_comes_with_the_program_has_its_doubt() {
    let prior = Prior::from_bytes(nvsprior_basin::PRIOR, "shipped", &Default::default()).unwrap();
    let doubt = prior.extras().doubt.as_ref().unwrap();
    assert_eq!(doubt.len(), prior.len());
    assert!(doubt.iter().any(|doubt| *doubt <= 16));
}

/// Without a driver for any device.
#[test]
fn a_run_is_drawn_without_a_device() {
    let dive = Dive::new();
    let none = [("VK_ICD_FILENAMES", "none.json"), ("VK_DRIVER_FILES", "none.json")];
    let draw = |args: &str| dive.run_with(&format!("demo --draw-only --frames 2 {args}"), &none);
    draw("--run T2 --out plain").ends_with(0);
    draw("--run T2 --rate 15 --out fast").ends_with(0);
    draw("--run T4 --out aged").ends_with(0);
    draw("--run T7 --width 160 --out tower").ends_with(0);
    draw("--out both").ends_with(0);
    draw("--run T1 --width 640 --out wide").ends_with(0);
    let files = |folder: &str| std::fs::read_dir(dive.path(folder)).unwrap().count();
    assert_eq!((files("plain"), files("plain/T2"), files("plain/T2/T2")), (2, 2, 2));
    assert_eq!(dive.bytes("plain/prior.nvsg"), nvsprior_basin::PRIOR);
    assert_eq!(files("both"), 3);
    assert_eq!(dive.bytes("both/T2/T2/0002.png"), dive.bytes("plain/T2/T2/0002.png"));
    assert_eq!(dive.bytes("fast/T2/T2/0001.png"), dive.bytes("plain/T2/T2/0001.png"));
    assert_eq!((files("aged"), files("tower"), files("tower/T7/T7")), (2, 1, 2));
    let wide = dive.json("wide/T1/cameras.json");
    assert_eq!((wide["width"].as_u64(), wide["height"].as_u64()), (Some(640), Some(360)));
    let half_view = wide["cx"].as_f64().unwrap() / wide["fx"].as_f64().unwrap();
    assert!((half_view - 35f64.to_radians().tan()).abs() < 1e-6, "{half_view}");
    let picture = image::open(dive.path("wide/T1/T1/0002.png")).unwrap();
    assert_eq!((picture.width(), picture.height()), (640, 360));
    let time = |folder: &str| dive.json(folder)["images"][1]["time"].as_f64();
    assert_eq!(time("plain/T2/cameras.json"), Some(1.0 / 3.0));
    assert_eq!(time("fast/T2/cameras.json"), Some(1.0 / 15.0));
}
