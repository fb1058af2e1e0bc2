//! Pictures in all forms: the same bits as the definition's and as the device's at hand, and close to the twin's.

use nvsprior::render::Plan;
use nvsprior::{Camera, Pose, Prior, RenderOptions};
use nvsprior_kernels::shared::PIXEL;
use nvsprior_reference::Twin;

use crate::chain::{Chain, FORMS, Settings, View};
use crate::common::{self, camera, random_pose, random_prior, random_splats};
use crate::difference::fault;

fn bits(image: &[f32]) -> Vec<u32> {
    image.iter().map(|v| v.to_bits()).collect()
}

fn assert_pictures(prior: &Prior, camera: Camera, pose: Pose, seed: u64) {
    let view = View::new(prior, camera, pose);
    let drawn = bits(&view.drawn.image);
    for form in FORMS {
        let mut chain = Chain::new(&view, Settings::new(form, seed));
        chain.tile_lists();
        chain.splat();
        assert!(chain.buffers["image"] == drawn, "{form:?}, seed {seed}");
        assert_eq!(fault(chain.get("image"), &Twin::new(prior).render(&camera, &pose)), None);
    }
}

#[test]
fn random_scenes() {
    for seed in 0..4 {
        let prior = random_prior(130 + seed, 600, seed as u32);
        for scheduler in [seed, 10 + seed] {
            assert_pictures(&prior, camera(50, 37), random_pose(130 + seed), scheduler);
        }
    }
}

#[test]
fn odd_sizes() {
    for (seed, (width, height)) in (1..).zip([(1, 1), (7, 1), (1, 9), (8, 8), (33, 17)]) {
        assert_pictures(&random_prior(140, 400, 1), camera(width, height), random_pose(140), seed);
    }
}

#[test]
fn options() {
    let background = [0.1, 0.7, 0.4];
    for (seed, options) in (1..).zip([
        RenderOptions { antialiased: true, ..RenderOptions::GSPLAT },
        RenderOptions {
            background,
            antialiased: true,
            alpha_max: 0.999,
            near: 1.5,
            trained_focal: None,
        },
        RenderOptions { trained_focal: Some(20.0), ..RenderOptions::INRIA },
        RenderOptions { trained_focal: Some(150.0), ..RenderOptions::INRIA },
    ]) {
        let prior = Prior::from_splats(random_splats(141, 500, 2), options).unwrap();
        assert_pictures(&prior, camera(43, 30), random_pose(141), seed);
    }
}

#[test]
fn without_a_clamp() {
    let mut splats = random_splats(142, 700, 0);
    splats.opacity_logits.iter_mut().for_each(|logit| *logit = logit.min(1.0));
    let prior = Prior::from_splats(splats, RenderOptions::GSPLAT).unwrap();
    let (camera, pose) = (camera(41, 29), random_pose(142));
    assert!(!View::new(&prior, camera, pose).analysis.clamps_alpha);
    assert_pictures(&prior, camera, pose, 3);
}

#[test]
fn opaque_splats_end_lists_early() {
    let mut splats = random_splats(143, 1_500, 0);
    splats.opacity_logits.iter_mut().for_each(|logit| *logit = logit.abs());
    let prior = Prior::from_splats(splats, RenderOptions::GSPLAT).unwrap();
    assert_pictures(&prior, camera(40, 24), random_pose(143), 4);
}

#[test]
fn without_depth() {
    let prior = random_prior(144, 500, 1);
    let view = View::new(&prior, camera(45, 31), random_pose(144));
    let colours = |image: &[u32]| -> Vec<[u32; 4]> {
        image.chunks_exact(PIXEL as usize).map(|p| [p[0], p[1], p[2], p[4]]).collect()
    };
    let drawn = colours(&bits(&view.drawn.image));
    for form in FORMS {
        let mut chain = Chain::new(&view, Settings { depth: false, ..Settings::new(form, 5) });
        chain.tile_lists();
        chain.splat();
        let image = &chain.buffers["image"];
        assert!(colours(image) == drawn, "{form:?}");
        assert!(image.iter().skip(3).step_by(PIXEL as usize).all(|depth| *depth == 0), "{form:?}");
    }
}

/// So the forms that no device here runs draw what the one that it does run draws.
#[test]
fn the_device_at_hand_draws_the_same() {
    let engine = common::engine();
    let (prior, camera, pose) = (random_prior(145, 800, 1), camera(60, 45), random_pose(145));
    let scene = engine.upload(&prior).unwrap();
    let mut renderer = engine.renderer(&scene, &camera, Plan::picture()).unwrap();
    let device = bits(renderer.draw(&pose).unwrap());
    let view = View::new(&prior, camera, pose);
    for form in FORMS {
        let mut chain = Chain::new(&view, Settings::new(form, 9));
        chain.tile_lists();
        chain.splat();
        assert!(chain.buffers["image"] == device, "{form:?}, {}", engine.device());
    }
    common::assert_silent(&engine);
}
