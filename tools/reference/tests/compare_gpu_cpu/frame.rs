//! The other work of a frame against the host: the pyramid, the search, the 8-bit pictures.

use nvsprior::image::Mask;
use nvsprior::render::{Cell, Correction, FlatField, Jacobian, Plan, Renderer, to_byte};
use nvsprior::tracking::{GaussNewtonOptions, Pyramid};
use nvsprior::{Camera, Engine, Picture, Pose, residual};
use nvsprior_kernels::search::{self, COMPACT, Placement, Program, STARTS, Search};
use nvsprior_kernels::shared::{MASKED, SUMS};

use crate::common::{self, assert_silent, random_pose, random_prior};

const FACTORS: [u32; 3] = [1, 2, 4];

fn camera() -> Camera {
    Camera { width: 150, height: 83, fx: 120.0, fy: 118.0, cx: 74.0, cy: 42.0 }
}

/// A renderer that knows frames, of a random scene.
fn renderer(engine: &Engine, seed: u64) -> Renderer {
    let scene = engine.upload(&random_prior(seed, 2_000, 1)).unwrap();
    let plan = Plan {
        factors: FACTORS.to_vec(),
        jacobians: vec![Jacobian::Flow],
        search: Some(Jacobian::Flow),
        ..Plan::picture()
    };
    engine.renderer(&scene, &camera(), plan).unwrap()
}

fn noise(seed: u64) -> Picture {
    let floats = common::random_frame(seed, &camera());
    Picture { width: 150, height: 83, data: floats.iter().map(|v| to_byte(*v)).collect() }
}

#[test]
fn the_pyramid_is_the_host_s() {
    let engine = common::engine();
    let mut renderer = renderer(&engine, 91);
    let frame = noise(91);
    let mut pyramid = Pyramid::new(&camera(), &FACTORS);
    pyramid.set(&frame);
    let pose = random_pose(91);
    for level in 0..FACTORS.len() {
        renderer.set_picture(&frame);
        renderer.reduce_picture().unwrap();
        let reduced = renderer.normal_equations(level, Jacobian::Flow, &pose).unwrap();
        renderer.set_frame(level, &vec![0.0; pyramid.level(level).len()]);
        let black = renderer.normal_equations(level, Jacobian::Flow, &pose).unwrap();
        assert_ne!(reduced, black, "the frame counts");
        renderer.set_frame(level, pyramid.level(level));
        let set = renderer.normal_equations(level, Jacobian::Flow, &pose).unwrap();
        assert_eq!(reduced, set, "level {level}");
    }
    assert_silent(&engine);
}

/// A random flat field: some cells do not count.
fn flat_field(seed: u64) -> FlatField {
    let mut field = FlatField::new(150, 83);
    let drawn = common::random_frame(seed, &camera());
    for (cell, drawn) in field.set().iter_mut().zip(drawn.chunks_exact(3)) {
        let counts = if drawn[2] < 0.7 { 1.0 } else { 0.0 };
        *cell = Cell { factor: 0.5 + drawn[0], summand: 0.2 * drawn[1], counts };
    }
    field
}

#[test]
fn the_light_of_the_pyramid_is_the_host_s() {
    let engine = common::engine();
    let mut renderer = renderer(&engine, 93);
    let frame = noise(93);
    let mut pyramid = Pyramid::new(&camera(), &FACTORS);
    pyramid.set(&frame);
    let field = flat_field(95);
    let correction = Correction { factor: [1.5, 0.8, 1.1], summand: [-0.1, 0.05, 0.2] };
    renderer.set_light(&correction, &field);
    let pose = random_pose(93);
    for (level, factor) in FACTORS.into_iter().enumerate() {
        renderer.set_picture(&frame);
        renderer.reduce_picture().unwrap();
        let reduced = renderer.normal_equations(level, Jacobian::Flow, &pose).unwrap();
        let width = (camera().width / factor) as usize;
        let mut masked = 0;
        let lit = |(i, rgb): (usize, &[f32])| {
            let rgb = std::array::from_fn(|c| correction.of(c, rgb[c]));
            let middle = |at: usize| (at as f32 + 0.5) * factor as f32;
            let rgb = field.of(rgb, middle(i % width), middle(i / width));
            masked += usize::from(rgb.is_none());
            rgb.unwrap_or([MASKED; 3])
        };
        let host: Vec<f32> =
            pyramid.level(level).chunks_exact(3).enumerate().flat_map(lit).collect();
        assert!(masked * 10 > host.len() / 3 && masked * 2 < host.len() / 3, "{masked} masked");
        renderer.set_frame(level, &host);
        let set = renderer.normal_equations(level, Jacobian::Flow, &pose).unwrap();
        assert!((reduced.square / set.square - 1.0).abs() < 1e-6, "level {level}");
        for (a, b) in reduced.jtr.iter().zip(&set.jtr) {
            assert!((a - b).abs() < 1e-5 * b.abs().max(1.0), "level {level}: {a}, {b}");
        }
        assert_eq!(reduced.jtj, set.jtj, "level {level}: the same pixels count");
    }
    assert_silent(&engine);
}

/// Blocks of which the mask covers a part do not count.
#[test]
fn the_mask_of_the_pyramid_is_the_host_s() {
    let engine = common::engine();
    let mut renderer = renderer(&engine, 96);
    let frame = noise(96);
    let mut pyramid = Pyramid::new(&camera(), &FACTORS);
    pyramid.set(&frame);
    // A bar, an edge, and single pixels.
    let mut mask = Mask::all(150, 83);
    for (i, counts) in mask.data.iter_mut().enumerate() {
        let (x, y) = (i % 150, i / 150);
        *counts = !((40..63).contains(&x) || x + 2 * y > 240 || i % 1013 == 5);
    }
    let pose = random_pose(96);
    for (level, factor) in FACTORS.into_iter().enumerate() {
        let reduced = mask.reduced(factor);
        let mut host = pyramid.level(level).to_vec();
        let pixels = host.chunks_exact_mut(3).zip(&reduced.data);
        pixels.filter(|(_, counts)| !**counts).for_each(|(rgb, _)| rgb.fill(MASKED));
        renderer.set_mask(Some(&mask));
        assert_eq!(renderer.counted(level)[0], reduced.count());
        renderer.set_picture(&frame);
        renderer.reduce_picture().unwrap();
        let masked = renderer.normal_equations(level, Jacobian::Flow, &pose).unwrap();
        renderer.set_frame(level, &host);
        let set = renderer.normal_equations(level, Jacobian::Flow, &pose).unwrap();
        assert_eq!(masked, set, "level {level}");
        assert_eq!(masked.residuals, 3 * reduced.count());
        renderer.set_mask(None);
        renderer.reduce_picture().unwrap();
        let all = renderer.normal_equations(level, Jacobian::Flow, &pose).unwrap();
        assert!(all.square > masked.square && all.residuals > masked.residuals);
    }
    assert_silent(&engine);
}

/// More pixels than a row of workgroups of the reduction holds.
#[test]
fn large_frames_are_reduced_whole() {
    let engine = common::engine();
    let camera = Camera { width: 512, height: 161, fx: 400.0, fy: 400.0, cx: 256.0, cy: 80.0 };
    let scene = engine.upload(&random_prior(94, 50, 0)).unwrap();
    let plan = Plan { jacobians: vec![Jacobian::Flow], ..Plan::picture() };
    let mut renderer = engine.renderer(&scene, &camera, plan).unwrap();
    let floats = common::random_frame(94, &camera);
    let data: Vec<u8> = floats.iter().map(|v| to_byte(*v)).collect();
    renderer.set_picture(&Picture { width: 512, height: 161, data: data.clone() });
    renderer.reduce_picture().unwrap();
    let away = Pose::exp(&[0.0, 0.0, -100.0, 0.0, 0.0, 0.0]);
    let square = renderer.normal_equations(0, Jacobian::Flow, &away).unwrap().square;
    // Nothing is in view, on black.
    let expected: f64 = data.iter().map(|v| (f64::from(*v) / 255.0).powi(2)).sum();
    assert!((square / expected - 1.0).abs() < 1e-5, "{square}, {expected}");
    assert_silent(&engine);
}

pub fn placement(pose: &Pose, centre: glam::DVec3) -> Placement {
    let translation = pose.translation + pose.rotation * centre;
    Placement {
        rotation: pose.wxyz().map(|v| v as f32),
        translation: translation.to_array().map(|v| v as f32),
    }
}

fn pose(placement: &Placement, centre: glam::DVec3) -> Pose {
    let [x, y, z] = placement.translation.map(f64::from);
    let wxyz = placement.rotation.map(f64::from);
    let pose = Pose::from_wxyz(wxyz, [x, y, z]).unwrap();
    Pose { translation: pose.translation - pose.rotation * centre, ..pose }
}

/// The device's search against the same search led by the host, with one evaluation per submission.
#[test]
fn the_search_is_the_host_s() {
    let engine = common::engine();
    let prior = random_prior(92, 2_000, 1);
    let mut renderer = renderer(&engine, 92);
    let centre = glam::DVec3::from(prior.coordinate_frame().centre.map(f64::from));
    let truth = random_pose(92);
    let mut frame = Picture::new(150, 83);
    renderer.picture(&truth, &mut frame).unwrap();
    let start = truth.stepped(&[0.01, -0.02, 0.02, 0.01, 0.008, -0.01]);
    let cold = GaussNewtonOptions::default().cold;
    let mut starts = [Placement::default(); STARTS];
    starts[0] = placement(&start, centre);
    let program = Program {
        starts,
        count: 1,
        first_level: 2,
        follow_level: 2,
        levels: cold.levels,
        sparse: 0,
        follow_renders: cold.follow_renders,
        coarse_renders: cold.coarse_renders,
        renders: cold.renders,
        near: cold.near,
        far_level: 0,
        coarse_leap: cold.coarse_leap,
        leap: cold.leap,
        coarse_tolerance: cold.coarse_tolerance,
        tolerance: cold.tolerance,
        damping: 1e-3,
        profile: COMPACT,
    };
    renderer.set_picture(&frame);
    let device = *renderer.search(&program).unwrap().search;

    renderer.reduce_picture().unwrap();
    let mut host: Search = bytemuck::Zeroable::zeroed();
    host.program = program;
    search::begin(&mut host);
    while host.phase == search::SEARCHING {
        let at = pose(&host.trial, centre);
        let level = host.level as usize;
        let e = renderer.normal_equations(level, Jacobian::Flow, &at).unwrap();
        let upper = (0..6).flat_map(|i| (i..6).map(move |j| (i, j))).map(|(i, j)| e.jtj[i][j]);
        let sums = upper.chain(e.jtr).chain([e.square]);
        for (to, from) in host.sums.iter_mut().zip(sums) {
            *to = from as f32;
        }
        search::advance(&mut host);
    }
    assert_eq!(device.phase, search::FOUND);
    assert_eq!(device.by_level, host.by_level);
    assert_eq!(device.sums.len(), SUMS as usize);
    // Depths count as equal to a part in 8,000 in evaluations on the device.
    let (found, expected) = (pose(&device.found, centre), pose(&host.found, centre));
    assert!(found.angle_to(&expected) < 2e-4, "{}", found.angle_to(&expected));
    assert!((found.translation - expected.translation).length() < 1e-3, "{found:?} {expected:?}");
    assert!(found.angle_to(&truth) < 2e-3, "{}", found.angle_to(&truth));
    assert_silent(&engine);
}

#[test]
fn eight_bit_pictures_are_the_host_s() {
    let engine = common::engine();
    let mut renderer = renderer(&engine, 93);
    let (frame, at) = (noise(93), random_pose(93));
    let floats = renderer.draw(&at).unwrap().to_vec();
    renderer.set_picture(&frame);
    let mut render = Picture::new(150, 83);
    renderer.picture(&at, &mut render).unwrap();
    let expected: Vec<u8> =
        floats.chunks_exact(5).flat_map(|p| p[..3].iter().map(|v| to_byte(*v))).collect();
    assert!(render.data == expected);
    assert!(renderer.difference() == residual::difference(&frame, &render).data);
    assert_silent(&engine);
}
