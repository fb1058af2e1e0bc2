//! Scenes at the edge of what can be drawn.

use nvsprior::prior::{Fault, Splats};
use nvsprior::render::{Jacobian, Plan};
use nvsprior::vulkan::Error;
use nvsprior::{Camera, Pose, Prior, RenderOptions};
use nvsprior_kernels::shared::TILE;

use crate::common::{self, camera, random_pose, random_splats};
use crate::difference::assert_same;

const BACKGROUND: [f32; 3] = [0.25, 0.5, 0.75];
const OPTIONS: RenderOptions = RenderOptions { background: BACKGROUND, ..RenderOptions::INRIA };

/// Grey splats of one size at the positions.
fn splats_at(positions: &[[f32; 3]], log_scale: f32) -> Splats {
    let count = positions.len();
    Splats {
        origin: [0.0; 3],
        positions: positions.to_vec(),
        log_scales: vec![[log_scale; 3]; count],
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; count],
        opacity_logits: vec![2.0; count],
        sh: vec![0.6; 3 * count],
        sh_degree: 0,
    }
}

fn prior_at(positions: &[[f32; 3]], log_scale: f32) -> Prior {
    Prior::from_splats(splats_at(positions, log_scale), OPTIONS).unwrap()
}

fn draw(prior: &Prior, camera: &Camera, pose: &Pose) -> Vec<f32> {
    let engine = common::engine();
    let scene = engine.upload(prior).unwrap();
    let mut renderer = engine.renderer(&scene, camera, Plan::picture()).unwrap();
    let pixels = renderer.draw(pose).unwrap().to_vec();
    common::assert_silent(&engine);
    pixels
}

fn assert_background(pixels: &[f32]) {
    let [r, g, b] = BACKGROUND;
    for (at, pixel) in pixels.chunks_exact(5).enumerate() {
        assert_eq!(pixel, [r, g, b, 0.0, 1.0], "pixel {at}");
    }
}

#[test]
fn one_splat() {
    let prior = prior_at(&[[0.1, -0.1, 3.0]], -1.5);
    assert_same("one-splat", &prior, &camera(40, 30), &Pose::IDENTITY);
    let pixels = draw(&prior, &camera(40, 30), &Pose::IDENTITY);
    assert!(pixels.chunks_exact(5).any(|p| p[4] < 0.5), "it shows");
}

#[test]
fn nothing_in_view_is_background() {
    let near = OPTIONS.near;
    // Behind, at the camera's centre, on the near plane, and far to the side.
    for position in [[0.0, 0.0, -3.0], [0.0; 3], [0.0, 0.0, near], [1e6, 0.0, 1.0]] {
        let prior = prior_at(&[position], -2.0);
        assert_background(&draw(&prior, &camera(33, 17), &Pose::IDENTITY));
    }
}

#[test]
fn just_beyond_the_near_plane_is_drawn() {
    let near = OPTIONS.near;
    let prior = prior_at(&[[0.0, 0.0, near * 1.001]], -4.0);
    assert_same("near", &prior, &camera(33, 17), &Pose::IDENTITY);
    let pixels = draw(&prior, &camera(33, 17), &Pose::IDENTITY);
    assert!(pixels.chunks_exact(5).any(|p| p[4] < 0.5), "it shows");
}

#[test]
fn invalid_splats_leave_no_trace() {
    let mut splats = random_splats(90, 500, 1);
    let valid = Prior::from_splats(splats.clone(), OPTIONS).unwrap();
    for value in [f32::NAN, f32::INFINITY] {
        splats.positions.push([0.0, value, 3.0]);
        splats.log_scales.push([0.0; 3]);
        splats.rotations.push([1.0, 0.0, 0.0, 0.0]);
        splats.opacity_logits.push(9.0);
        splats.sh.extend([9.0; 12]);
    }
    let mixed = Prior::from_splats(splats, OPTIONS).unwrap();
    let dropped = &mixed.report().dropped;
    assert_eq!((dropped.len(), dropped[0].fault, dropped[0].count), (1, Fault::NonFinite, 2));
    let (camera, pose) = (camera(40, 30), random_pose(90));
    assert_eq!(draw(&mixed, &camera, &pose), draw(&valid, &camera, &pose));
}

#[test]
fn huge_and_tiny_splats() {
    let around = [[0.0, 0.0, 2.0], [1.0, 0.5, 3.0], [-30.0, 4.0, 2.5], [0.3, 900.0, 5.0]];
    for log_scale in [-40.0, -15.0, 3.0, 10.0, 20.0, 40.0] {
        let prior = prior_at(&around, log_scale);
        assert_same(&format!("scale-{log_scale}"), &prior, &camera(40, 30), &Pose::IDENTITY);
    }
}

#[test]
fn needles() {
    let mut splats = random_splats(91, 300, 0);
    for (i, scale) in splats.log_scales.iter_mut().enumerate() {
        *scale = [-12.0, -9.0, if i % 2 == 0 { 0.5 } else { -1.0 }];
    }
    let prior = Prior::from_splats(splats, OPTIONS).unwrap();
    assert_same("needles", &prior, &camera(64, 48), &random_pose(91));
}

#[test]
fn the_largest_scales_give_numbers() {
    let mut splats = splats_at(&[[0.0, 0.0, 2.0], [0.5, 0.0, 4.0]], 40.0);
    splats.log_scales[1] = [40.0, -40.0, 0.0];
    let prior = Prior::from_splats(splats, OPTIONS).unwrap();
    let pixels = draw(&prior, &camera(33, 17), &random_pose(92));
    assert!(pixels.iter().all(|v| v.is_finite()));
}

#[test]
fn the_farthest_positions_give_numbers() {
    let far = f32::MAX;
    let positions = [[far, -far, 2.0], [far, far, far], [-far, 1.0, 1.0], [0.0, 0.0, far]];
    let prior = prior_at(&positions, 2.0);
    for pose in [Pose::IDENTITY, random_pose(95)] {
        let pixels = draw(&prior, &camera(33, 17), &pose);
        assert!(pixels.iter().all(|v| v.is_finite()));
    }
}

#[test]
fn a_pose_that_is_not_a_number_draws_background() {
    let prior = Prior::from_splats(random_splats(93, 500, 1), OPTIONS).unwrap();
    let mut pose = Pose::IDENTITY;
    pose.translation.z = f64::NAN;
    assert_background(&draw(&prior, &camera(33, 17), &pose));
}

#[test]
fn more_pairs_than_room_at_first() {
    // Each of these covers the whole picture: the renderer has to grow.
    let mut splats = random_splats(94, 200, 0);
    splats.positions.iter_mut().for_each(|p| p[2] = p[2].abs() + 2.0);
    splats.log_scales.iter_mut().for_each(|s| *s = [1.0; 3]);
    splats.opacity_logits.iter_mut().for_each(|o| *o = -3.0);
    let prior = Prior::from_splats(splats, OPTIONS).unwrap();
    assert_same("grown", &prior, &camera(320, 180), &random_pose(94));
}

#[test]
fn more_pairs_than_the_device_holds_is_an_error_each_time() {
    let engine = common::engine();
    let (camera, count) = (camera(1024, 1024), 3_000);
    let pairs = u64::from((camera.width / TILE).pow(2)) * count as u64;
    if engine.device().storage_range >= 4 * pairs {
        println!("skipped: {} holds {pairs} pairs", engine.device());
        return;
    }
    let prior = prior_at(&vec![[0.0, 0.0, 3.0]; count], 3.0);
    let scene = engine.upload(&prior).unwrap();
    let mut renderer = engine.renderer(&scene, &camera, Plan::picture()).unwrap();
    for _ in 0..2 {
        let refused = renderer.draw(&Pose::IDENTITY);
        let told = matches!(refused, Err(Error::BufferTooLarge { .. } | Error::TooManyPairs));
        assert!(told, "{refused:?}");
    }
    let away = Pose::exp(&[0.0, 0.0, -10.0, 0.0, 0.0, 0.0]);
    assert_background(renderer.draw(&away).unwrap());
    common::assert_silent(&engine);
}

/// Many splats that each fill the picture: a workgroup of binning then has more pairs than some drivers let it go
/// through. The work must be shared among more workgroups.
#[test]
fn many_wide_splats() {
    let positions: Vec<[f32; 3]> = (0..12_000).map(|i| [0.0, 0.0, 3.0 + 1e-4 * i as f32]).collect();
    let mut splats = splats_at(&positions, 1.0);
    // Faint, so that no splat hides those behind it.
    splats.opacity_logits.fill(-5.4);
    let prior = Prior::from_splats(splats, OPTIONS).unwrap();
    assert_same("many-wide-splats", &prior, &camera(320, 180), &Pose::IDENTITY);
}

#[test]
fn too_many_splats_for_a_buffer_are_told_with_what_fits() {
    let engine = common::engine();
    let count = engine.device().storage_range / (14 * 4) + 1;
    if count > 5_000_000 {
        println!("skipped: {} holds more splats than are made here", engine.device());
        return;
    }
    let prior = prior_at(&vec![[0.0, 0.0, 3.0]; count as usize], -3.0);
    let Err(refused) = engine.upload(&prior) else { panic!("{count} splats fit") };
    let told = format!("; {} splats of degree 0 would fit", count - 1);
    assert!(refused.to_string().ends_with(&told), "{refused}");
}

/// Drivers that end long loops must be noticed: llvmpipe goes 65,535 rounds, one per splat here.
#[test]
fn a_list_is_gone_through_or_refused() {
    let engine = common::engine();
    let camera = Camera { width: 8, height: 8, fx: 8.0, fy: 8.0, cx: 4.0, cy: 4.0 };
    // All in the first pixel's corner; one splat behind them covers the tile.
    let mut splats = splats_at(&vec![[-1.75, -1.75, 4.0]; 70_000], -8.0);
    splats.opacity_logits.fill(-5.0);
    let one = splats_at(&[[0.0, 0.0, 9.0]], 3.0);
    splats.positions.extend(one.positions);
    splats.log_scales.extend(one.log_scales);
    splats.rotations.extend(one.rotations);
    splats.opacity_logits.push(6.0);
    splats.sh.extend([3.0; 3]);
    let prior = Prior::from_splats(splats, OPTIONS).unwrap();
    let scene = engine.upload(&prior).unwrap();
    let frame = vec![0.5; 8 * 8 * 3];
    let twin = nvsprior_reference::Twin::new(&prior);
    for jacobian in [Jacobian::Flow, Jacobian::Exact] {
        let plan = Plan { jacobians: vec![jacobian], ..Plan::picture() };
        let mut renderer = engine.renderer(&scene, &camera, plan).unwrap();
        renderer.set_frame(0, &frame);
        match renderer.normal_equations(0, jacobian, &Pose::IDENTITY) {
            Err(Error::TooManyPairs) => println!("{jacobian:?}: refused"),
            got => {
                println!("{jacobian:?}: gone through");
                let got = got.unwrap().jtj[0][0];
                let expected =
                    twin.normal_equations(&camera, &Pose::IDENTITY, &frame, jacobian).jtj[0][0];
                assert!((got / expected - 1.0).abs() < 1e-2, "{jacobian:?}: {got}, {expected}");
            }
        }
    }
    common::assert_silent(&engine);
}
