//! Whole pictures against the twin.

use nvsprior::render::Plan;
use nvsprior::{Prior, RenderOptions};

use crate::common::{self, camera, random_pose, random_prior, random_splats};
use crate::difference::assert_same;

#[test]
fn every_sh_degree() {
    for degree in 0..=3 {
        let seed = u64::from(degree);
        let prior = random_prior(seed, 2_000, degree);
        assert_same(&format!("degree-{degree}"), &prior, &camera(96, 64), &random_pose(seed));
    }
}

#[test]
fn odd_sizes() {
    for (width, height) in [(1, 1), (7, 1), (1, 9), (33, 17), (8, 8), (9, 16), (320, 180)] {
        let prior = random_prior(10, 3_000, 1);
        let name = format!("size-{width}x{height}");
        assert_same(&name, &prior, &camera(width, height), &random_pose(10));
    }
}

#[test]
fn options() {
    let background = [0.1, 0.7, 0.4];
    for (at, options) in [
        RenderOptions::INRIA,
        RenderOptions { antialiased: true, ..RenderOptions::GSPLAT },
        RenderOptions { background, ..RenderOptions::GSPLAT },
        RenderOptions {
            background,
            antialiased: true,
            alpha_max: 0.999,
            near: 1.5,
            trained_focal: None,
        },
        RenderOptions { trained_focal: Some(20.0), ..RenderOptions::INRIA },
        RenderOptions { trained_focal: Some(150.0), ..RenderOptions::INRIA },
    ]
    .into_iter()
    .enumerate()
    {
        let prior = Prior::from_splats(random_splats(20, 2_000, 2), options).unwrap();
        assert_same(&format!("options-{at}"), &prior, &camera(96, 64), &random_pose(20));
    }
}

#[test]
fn dense_and_opaque() {
    let mut splats = random_splats(30, 20_000, 0);
    splats.opacity_logits.iter_mut().for_each(|logit| *logit = logit.abs());
    let prior = Prior::from_splats(splats, RenderOptions::GSPLAT).unwrap();
    assert_same("dense", &prior, &camera(160, 90), &random_pose(30));
}

#[test]
fn reef() {
    let Some(prior) = common::reef_prior() else { return };
    assert_same("reef", &prior, &common::REEF_CAMERA, &common::reef_pose());
}

#[test]
fn same_picture_every_time() {
    let engine = common::engine();
    let prior = random_prior(40, 5_000, 3);
    let scene = engine.upload(&prior).unwrap();
    let (camera, pose) = (camera(160, 90), random_pose(40));
    let mut first = engine.renderer(&scene, &camera, Plan::picture()).unwrap();
    let mut second = engine.renderer(&scene, &camera, Plan::picture()).unwrap();
    let expected = first.draw(&pose).unwrap().to_vec();
    let bytes: &[u8] = bytemuck::cast_slice(&expected);
    assert_ne!(first.draw(&random_pose(41)).unwrap(), expected, "another pose, another picture");
    assert!(bytemuck::cast_slice::<_, u8>(first.draw(&pose).unwrap()) == bytes, "drawn again");
    assert!(bytemuck::cast_slice::<_, u8>(second.draw(&pose).unwrap()) == bytes, "drawn elsewhere");
    common::assert_silent(&engine);
}
