//! The normal equations in all forms against the twin's.

use nvsprior::render::{Jacobian, NormalEquations};
use nvsprior::{Camera, Pose, Prior, RenderOptions};
use nvsprior_kernels::modules;
use nvsprior_kernels::shared::{DERIVATIVES, Groups, MASKED, SUMS, TILE};
use nvsprior_reference::Twin;

use crate::agreement::assert_equations;
use crate::chain::{Chain, FORMS, Settings, View};
use crate::common::{camera, random_frame, random_pose, random_prior, random_splats};

/// Runs the stages of an evaluation.
fn evaluated(view: &View, settings: Settings, frame: &[f32]) -> [f64; SUMS as usize] {
    let mut chain = Chain::new(view, settings);
    chain.set("frame", frame);
    chain.tile_lists();
    chain.equations()
}

fn assert_same(prior: &Prior, camera: Camera, pose: Pose, frame: &[f32], with: Settings) {
    let view = View::new(prior, camera, pose);
    let expected = Twin::new(prior).normal_equations(&camera, &pose, frame, Jacobian::Flow);
    for form in FORMS {
        let sums = evaluated(&view, Settings { form, ..with }, frame);
        let got = NormalEquations::from_sums(&sums, expected.residuals);
        assert_equations(&format!("{form:?}, seed {}", with.seed), &got, &expected);
    }
}

#[test]
fn random_scenes() {
    for seed in 0..4 {
        let prior = random_prior(150 + seed, 500, seed as u32 % 3);
        let (camera, pose) = (camera(47, 35), random_pose(150 + seed));
        let frame = random_frame(150 + seed, &camera);
        for scheduler in [seed, 10 + seed] {
            assert_same(&prior, camera, pose, &frame, Settings::new(FORMS[0], scheduler));
        }
    }
}

#[test]
fn masked_pixels_do_not_count() {
    let (prior, camera, pose) = (random_prior(155, 500, 1), camera(44, 33), random_pose(155));
    let mut frame = random_frame(155, &camera);
    for (i, rgb) in frame.chunks_exact_mut(3).enumerate() {
        if i % 7 < 3 || i % 44 > 30 {
            rgb.fill(MASKED);
        }
    }
    assert_same(&prior, camera, pose, &frame, Settings::new(FORMS[0], 2));
}

#[test]
fn without_a_clamp_and_over_a_background() {
    let mut splats = random_splats(156, 600, 0);
    splats.opacity_logits.iter_mut().for_each(|logit| *logit = logit.min(1.0));
    let options = RenderOptions { background: [0.1, 0.7, 0.4], ..RenderOptions::GSPLAT };
    let prior = Prior::from_splats(splats, options).unwrap();
    let (camera, pose) = (camera(39, 30), random_pose(156));
    assert!(!View::new(&prior, camera, pose).analysis.clamps_alpha);
    let frame = random_frame(156, &camera);
    assert_same(&prior, camera, pose, &frame, Settings::new(FORMS[0], 3));
}

/// The exact Jacobian has one form.
#[test]
fn exact() {
    let (prior, camera, pose) = (random_prior(158, 500, 1), camera(37, 30), random_pose(158));
    let view = View::new(&prior, camera, pose);
    let frame = random_frame(158, &camera);
    let mut chain = Chain::new(&view, Settings::new(FORMS[1], 1));
    chain.set("frame", &frame);
    chain.set("derivatives", &vec![0_u32; 4 * (DERIVATIVES * (chain.params.splats + 1)) as usize]);
    chain.tile_lists();
    let Groups { splats, tiles, .. } = Groups::of(&chain.params);
    let names = ["params", "geometry", "sh", "records", "keys", "derivatives"];
    chain.run(&modules::pose_jacobian, splats, &[], &names);
    let names = [
        "params",
        "ranges",
        "pair splats",
        "records",
        "frame",
        "partials",
        "derivatives",
        "counters",
    ];
    chain.run(&modules::splat_exact, tiles, &[], &names);
    let expected = Twin::new(&prior).normal_equations(&camera, &pose, &frame, Jacobian::Exact);
    let got = NormalEquations::from_sums(&chain.reduced(), expected.residuals);
    assert_equations("exact", &got, &expected);
}

/// Rows of tiles that are not drawn count as if they were masked.
#[test]
fn some_rows_of_tiles() {
    let (prior, camera, pose) = (random_prior(157, 600, 1), camera(40, 61), random_pose(157));
    for row_shift in [1, 2] {
        let settings = Settings { row_shift, ..Settings::new(FORMS[0], u64::from(row_shift)) };
        let view = View::new(&prior, camera, pose);
        let params = Chain::new(&view, settings).params;
        let mut frame = random_frame(157, &camera);
        for (y, row) in (0..).zip(frame.chunks_exact_mut(3 * camera.width as usize)) {
            if !params.draws(y / TILE) {
                row.fill(MASKED);
            }
        }
        assert_same(&prior, camera, pose, &frame, settings);
    }
}
