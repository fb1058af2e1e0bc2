//! The normal equations of the device against the twin's.

use nvsprior::render::{Jacobian, Plan, Renderer};
use nvsprior::{Camera, Pose, Prior, RenderOptions};
use nvsprior_kernels::shared::MASKED;
use nvsprior_reference::Twin;

use crate::agreement::assert_equations;
use crate::common::{self, camera, random_frame, random_pose, random_prior, random_splats};

const BOTH: [Jacobian; 2] = [Jacobian::Flow, Jacobian::Exact];

fn renderer(prior: &Prior, camera: &Camera) -> Renderer {
    let engine = common::engine();
    let scene = engine.upload(prior).unwrap();
    let plan = Plan { jacobians: BOTH.to_vec(), ..Plan::picture() };
    engine.renderer(&scene, camera, plan).unwrap()
}

fn assert_same(what: &str, prior: &Prior, camera: &Camera, pose: &Pose) {
    assert_same_of(what, prior, camera, pose, &random_frame(80, camera));
}

fn assert_same_of(what: &str, prior: &Prior, camera: &Camera, pose: &Pose, frame: &[f32]) {
    let twin = Twin::new(prior);
    let mut renderer = renderer(prior, camera);
    renderer.set_frame(0, frame);
    for jacobian in BOTH {
        let got = renderer.normal_equations(0, jacobian, pose).unwrap();
        let expected = twin.normal_equations(camera, pose, frame, jacobian);
        assert_equations(&format!("{what}, {jacobian:?}"), &got, &expected);
    }
    common::assert_silent(&common::engine());
}

#[test]
fn random_scenes() {
    for seed in 80..84 {
        let prior = random_prior(seed, 2_000, (seed % 4) as u32);
        assert_same(&format!("seed {seed}"), &prior, &camera(96, 64), &random_pose(seed));
    }
    let prior = random_prior(84, 1_000, 1);
    assert_same("odd size", &prior, &camera(33, 17), &random_pose(84));
}

#[test]
fn masked_pixels_do_not_count() {
    let (prior, camera, pose) = (random_prior(86, 2_000, 1), camera(96, 64), random_pose(86));
    let mut frame = random_frame(86, &camera);
    for (i, rgb) in frame.chunks_exact_mut(3).enumerate() {
        if i % 7 < 3 || i % 96 > 60 {
            rgb.fill(MASKED);
        }
    }
    assert_same_of("masked", &prior, &camera, &pose, &frame);
    frame.fill(MASKED);
    let mut renderer = renderer(&prior, &camera);
    renderer.set_frame(0, &frame);
    for jacobian in BOTH {
        let nothing = renderer.normal_equations(0, jacobian, &pose).unwrap();
        assert_eq!((nothing.square, nothing.jtr), (0.0, [0.0; 6]), "{jacobian:?}");
    }
}

#[test]
fn options() {
    let background = [0.1, 0.7, 0.4];
    for options in [
        RenderOptions { antialiased: true, ..RenderOptions::INRIA },
        RenderOptions { background, ..RenderOptions::GSPLAT },
    ] {
        let prior = Prior::from_splats(random_splats(85, 2_000, 2), options).unwrap();
        assert_same(&format!("{options:?}"), &prior, &camera(96, 64), &random_pose(85));
    }
}

/// Long needles: entries of a covariance are as large as the length squared, while only a few
/// pixels of it matter.
#[test]
fn needles() {
    let mut splats = random_splats(89, 300, 1);
    splats.positions.iter_mut().for_each(|p| p[2] = p[2].abs() + 2.0);
    splats.log_scales.iter_mut().for_each(|s| *s = [-4.0, -4.0, 4.0]);
    let prior = Prior::from_splats(splats, RenderOptions::INRIA).unwrap();
    assert_same("needles", &prior, &camera(64, 48), &random_pose(89));
}

#[test]
fn reef() {
    let Some(prior) = common::reef_prior() else { return };
    assert_same("reef", &prior, &common::REEF_CAMERA, &common::reef_pose());
}

#[test]
fn levels_are_cameras_of_their_own() {
    let prior = random_prior(86, 2_000, 1);
    let (camera, pose) = (camera(100, 60), random_pose(86));
    let engine = common::engine();
    let scene = engine.upload(&prior).unwrap();
    let plan = Plan { factors: vec![1, 4], jacobians: vec![Jacobian::Flow], ..Plan::picture() };
    let mut renderer = engine.renderer(&scene, &camera, plan).unwrap();
    let coarse = camera.reduced(4);
    assert_eq!(*renderer.camera(1), coarse);
    let frame = random_frame(86, &coarse);
    renderer.set_frame(1, &frame);
    let got = renderer.normal_equations(1, Jacobian::Flow, &pose).unwrap();
    let twin = Twin::new(&prior).reduced(4);
    let expected = twin.normal_equations(&coarse, &pose, &frame, Jacobian::Flow);
    assert_equations("level 1", &got, &expected);
}

#[test]
fn same_sums_every_time() {
    let prior = random_prior(87, 3_000, 1);
    let (camera, pose) = (camera(96, 64), random_pose(87));
    let (mut first, mut second) = (renderer(&prior, &camera), renderer(&prior, &camera));
    let frame = random_frame(87, &camera);
    first.set_frame(0, &frame);
    second.set_frame(0, &frame);
    for jacobian in BOTH {
        let expected = first.normal_equations(0, jacobian, &pose).unwrap();
        assert_ne!(first.normal_equations(0, jacobian, &random_pose(88)).unwrap(), expected);
        assert_eq!(first.normal_equations(0, jacobian, &pose).unwrap(), expected);
        assert_eq!(second.normal_equations(0, jacobian, &pose).unwrap(), expected);
    }
}
