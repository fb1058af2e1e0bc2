//! What is left out when a prior is loaded changes no picture.

mod common;
mod scene;

use common::{assert_silent, camera, engine, random_pose, random_splats, reef_file, reef_pose};
use nvsprior::prior::Splats;
use nvsprior::render::{Jacobian, Plan, Scene};
use nvsprior::{Camera, Engine, Pose, Prior, RenderOptions};
use proptest::prelude::*;
use proptest::test_runner::{Config, TestRunner};
use std::sync::Arc;

/// Floats, bytes and normal equations of a prior at every level.
fn seen(engine: &Engine, scene: &Arc<Scene>, camera: &Camera, pose: &Pose) -> Vec<u32> {
    let jacobians = vec![Jacobian::Flow, Jacobian::Exact];
    let plan = Plan { factors: vec![1, 2], jacobians, ..Plan::picture() };
    let mut renderer = engine.renderer(scene, camera, plan).unwrap();
    let mut words = Vec::new();
    for level in 0..renderer.levels() {
        let size = renderer.camera(level).pixels() * 3;
        renderer.set_frame(level, &vec![0.5; size]);
        words.extend(renderer.draw_level(level, pose).unwrap().iter().map(|v| v.to_bits()));
        for jacobian in [Jacobian::Flow, Jacobian::Exact] {
            let sums = renderer.normal_equations(level, jacobian, pose).unwrap();
            words.extend(format!("{sums:?}").bytes().map(u32::from));
        }
    }
    words
}

/// Fails if the scene as uploaded shows another picture than the whole scene.
fn assert_same(engine: &Engine, prior: &Prior, camera: &Camera, pose: &Pose) -> Arc<Scene> {
    let (reduced, whole) = (engine.upload(prior).unwrap(), engine.upload_whole(prior).unwrap());
    assert_eq!((reduced.id(), reduced.coordinate_frame()), (whole.id(), whole.coordinate_frame()));
    let same = seen(engine, &reduced, camera, pose) == seen(engine, &whole, camera, pose);
    assert!(same, "{:?}", reduced.analysis().findings());
    reduced
}

/// Adds a splat that shows nothing after every `nth`, with opacities up to just below 1/255.
fn with_invisible(splats: &Splats, nth: usize) -> Splats {
    let mut mixed = Splats { sh_degree: splats.sh_degree, ..Splats::default() };
    let stride = splats.sh_stride();
    let limit = -(254.0_f32.ln()) - 1e-4;
    for i in 0..splats.len() {
        for twice in 0..1 + usize::from(i % nth == 0) {
            mixed.positions.push(splats.positions[i]);
            mixed.log_scales.push(splats.log_scales[i]);
            mixed.rotations.push(splats.rotations[i]);
            let hidden = limit - (i % 3) as f32;
            mixed.opacity_logits.push(if twice == 1 { hidden } else { splats.opacity_logits[i] });
            mixed.sh.extend(&splats.sh[i * stride..][..stride]);
        }
    }
    mixed
}

#[test]
fn what_is_left_out_changes_no_picture() {
    let engine = engine();
    let camera = camera(61, 47);
    let config = Config { cases: 24, failure_persistence: None, ..Config::default() };
    let cases = (any::<u16>(), 0..=3_u32, 0..=3_u32, 1..7_usize, 0.3..0.999_f32, any::<bool>());
    let run =
        |(seed, degree, kept, nth, alpha_max, antialiased): (u16, u32, u32, usize, f32, bool)| {
            let mut splats = random_splats(seed.into(), 300, degree);
            let coefficients = (kept as usize + 1).pow(2) * 3;
            let stride = splats.sh_stride();
            for own in splats.sh.chunks_exact_mut(stride) {
                own.iter_mut().skip(coefficients).for_each(|v| *v = 0.0);
            }
            let splats = with_invisible(&splats, nth);
            let options = RenderOptions { alpha_max, antialiased, ..RenderOptions::GSPLAT };
            let prior = Prior::from_splats(splats, options).unwrap();
            let scene = assert_same(&engine, &prior, &camera, &random_pose(seed.into()));
            prop_assert_eq!(scene.analysis().splats.len(), 300);
            prop_assert_eq!(scene.analysis().sh_degree, degree.min(kept));
            Ok(())
        };
    TestRunner::new(config).run(&cases, run).unwrap();
    assert_silent(&engine);
}

#[test]
fn a_prior_that_shows_nothing_shows_its_background() {
    let engine = engine();
    let mut splats = random_splats(3, 40, 1);
    splats.opacity_logits.fill(-8.0);
    let options = RenderOptions { background: [0.2, 0.4, 0.6], ..RenderOptions::GSPLAT };
    let prior = Prior::from_splats(splats, options).unwrap();
    let (camera, pose) = (camera(33, 20), random_pose(1));
    let scene = assert_same(&engine, &prior, &camera, &pose);
    assert_eq!(scene.analysis().splats, [0]);
    let mut renderer = engine.renderer(&scene, &camera, Plan::picture()).unwrap();
    let floats = renderer.draw(&pose).unwrap();
    assert!(floats.chunks_exact(5).all(|p| p == [0.2, 0.4, 0.6, 0.0, 1.0]), "{:?}", &floats[..5]);
}

#[test]
fn the_wall_needs_all_that_it_has() {
    let prior = scene::wall(1);
    let scene = assert_same(&engine(), &prior, &scene::CAMERA, &scene::pose(1.0));
    assert_eq!(scene.analysis().splats.len(), prior.len());
    assert_eq!(scene.analysis().findings(), []);
}

#[test]
fn the_reef_is_drawn_to_the_same_bits() {
    let Some(path) = reef_file("prior.ply") else { return };
    let prior = Prior::open(&path, &Default::default()).unwrap();
    let scene = assert_same(&engine(), &prior, &common::REEF_CAMERA, &reef_pose());
    println!("left out of {}: {:?}", prior.len(), scene.analysis().findings());
}
