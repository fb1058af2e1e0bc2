//! Training through the public API, on pictures that a random prior drew.

#[path = "../../../tests/common/mod.rs"]
mod common;

use glam::DVec3;

use nvsprior::render::Plan;
use nvsprior::vulkan::DeviceInfo;
use nvsprior::{Engine, Picture, Pose, Prior};
use nvsprior_train::PosedPicture;
use nvsprior_train::mapper::{
    ColouredPoint, MapError, MapOptions, Mapper, Schedule, read_state, write_state,
};
use nvsprior_train::trainer::{Fits, Shortage};

const STEPS: u32 = 1200;

/// Pictures of a random prior, and points near its splats.
fn scene(engine: &Engine) -> (Vec<PosedPicture>, Vec<ColouredPoint>) {
    scene_of([72, 52], engine)
}

/// The same in pictures of some size.
fn scene_of(size: [u32; 2], engine: &Engine) -> (Vec<PosedPicture>, Vec<ColouredPoint>) {
    let prior = common::random_prior(5, 300, 0);
    let camera = common::camera(size[0], size[1]);
    let uploaded = engine.upload(&prior).unwrap();
    let mut renderer = engine.renderer(&uploaded, &camera, Plan::picture()).unwrap();
    let view = |seed: u64| {
        let pose = common::random_pose(seed);
        let mut picture = Picture::new(camera.width, camera.height);
        renderer.picture(&pose, &mut picture).unwrap();
        PosedPicture::new(camera, pose, picture)
    };
    let views = (0..12).map(view).collect();
    let positions = prior.splats().positions.iter();
    let points = positions.map(|position| ColouredPoint { position: *position, rgb: [0.5; 3] });
    (views, points.collect())
}

fn options() -> MapOptions {
    MapOptions { splats: 500, sh_degree: 1, ..MapOptions::default() }
}

/// All that a training can be asked for.
fn all_options() -> MapOptions {
    MapOptions { exposure: true, correct_poses: true, ..options() }
}

/// Steps up to `end`, of [`STEPS`].
fn train(mapper: &mut Mapper, end: u32) {
    while mapper.steps() < end {
        mapper.step(f64::from(mapper.steps()) / f64::from(STEPS)).unwrap();
    }
}

fn psnr(mapper: &mut Mapper) -> f64 {
    let views = mapper.views().to_vec();
    psnr_of(mapper, &views)
}

#[test]
fn training_fits_the_pictures_and_is_the_same_again_also_if_interrupted() {
    let engine = common::engine();
    let (views, points) = scene(&engine);
    let new = || Mapper::new(&engine, views.clone(), &points, &all_options()).unwrap();
    let mut whole = new();
    let before = psnr(&mut whole);
    train(&mut whole, STEPS);
    let after = psnr(&mut whole);
    assert!(after > before + 5.0, "{before} dB before, {after} dB after");
    assert!(whole.alive() > 300, "{} splats", whole.alive());

    let mut half = new();
    train(&mut half, 617);
    let saved = write_state(&half.state().unwrap(), 7);
    drop(half);
    let mut rest = new();
    rest.resume(&read_state(&saved, 7).unwrap()).unwrap();
    train(&mut rest, STEPS);
    assert!(rest.state().unwrap() == whole.state().unwrap(), "another result");
    common::assert_silent(&engine);
}

#[test]
fn pictures_that_grow_give_the_same_again_also_if_interrupted() {
    const ALL: u32 = 500;
    let engine = common::engine();
    let (views, points) = scene_of([180, 160], &engine);
    let options = MapOptions { exposure: true, ..options() };
    let factor = |step: u32| options.schedule.factor(f64::from(step) / f64::from(ALL), [180, 160]);
    // The first fit of the light, after step 96, falls between the two.
    assert_eq!([0, 98, 110].map(factor), [2, 2, 1]);
    let new = || Mapper::new(&engine, views.clone(), &points, &options).unwrap();
    let train = |mapper: &mut Mapper, end: u32| {
        while mapper.steps() < end {
            mapper.step(f64::from(mapper.steps()) / f64::from(ALL)).unwrap();
        }
    };
    let mut whole = new();
    train(&mut whole, 150);
    for interrupted in [98, 110] {
        let mut half = new();
        train(&mut half, interrupted);
        let saved = half.state().unwrap();
        drop(half);
        let mut rest = new();
        rest.resume(&saved).unwrap();
        train(&mut rest, 150);
        assert!(rest.state().unwrap() == whole.state().unwrap(), "interrupted at {interrupted}");
    }
    common::assert_silent(&engine);
}

#[test]
fn what_is_held_out_is_not_learnt_from() {
    const UNTIL: u32 = 700;
    let engine = common::engine();
    let (views, points) = scene(&engine);
    let mut others = views.clone();
    others[4].picture.data.fill(90);
    let [mut own, mut other] = [views, others].map(|views| {
        let mut mapper = Mapper::new(&engine, views, &points, &options()).unwrap();
        mapper.hold_out(&[4]);
        train(&mut mapper, UNTIL);
        assert!(mapper.holds_out());
        mapper
    });
    assert!(own.state().unwrap() == other.state().unwrap(), "it was looked at");
    for mapper in [&mut own, &mut other] {
        mapper.hold_out(&[]);
        assert!(!mapper.holds_out());
        train(mapper, UNTIL + 24);
    }
    assert!(own.state().unwrap() != other.state().unwrap(), "it is not looked at");
}

/// How well views are drawn, dB.
fn psnr_of(mapper: &mut Mapper, views: &[PosedPicture]) -> f64 {
    let of =
        |view: &PosedPicture| mapper.picture(&view.camera, &view.pose).unwrap().psnr(&view.picture);
    views.iter().map(of).sum::<f64>() / views.len() as f64
}

#[test]
fn light_that_changes_from_picture_to_picture_is_undone() {
    let engine = common::engine();
    let (mut clean, points) = scene(&engine);
    // So dark that nothing is clipped in brighter light.
    let bytes = clean.iter_mut().flat_map(|view| &mut view.picture.data);
    bytes.for_each(|byte| *byte = (f32::from(*byte) * 0.7) as u8);
    let mut seen = clean.clone();
    for (i, view) in seen.iter_mut().enumerate() {
        // The mean over all is no change.
        let gain = if i % 2 == 0 { 0.75 } else { 1.25 };
        let lit = |byte: &mut u8| *byte = (f32::from(*byte) * gain).min(255.0) as u8;
        view.picture.data.iter_mut().for_each(lit);
    }
    let trained = |exposure| {
        let options = MapOptions { exposure, ..options() };
        let mut mapper = Mapper::new(&engine, seen.clone(), &points, &options).unwrap();
        train(&mut mapper, STEPS);
        let psnr = psnr_of(&mut mapper, &clean);
        (psnr, mapper.state().unwrap().exposures)
    };
    let ((without, _), (with, exposures)) = (trained(false), trained(true));
    assert!(with > without - 0.1, "{without} dB without, {with} dB with exposure");
    // What the pictures are without their light.
    let mean =
        |psnr: &dyn Fn(usize) -> f64| (0..seen.len()).map(psnr).sum::<f64>() / seen.len() as f64;
    let lit = mean(&|i| seen[i].psnr(&clean[i].picture));
    let undone = mean(&|i| exposures[i].undone_picture(&seen[i]).psnr(&clean[i].picture));
    assert!(undone > lit + 6.0, "{lit} dB as they are, {undone} dB undone");
    for (i, exposure) in exposures.iter().enumerate() {
        let grey = (exposure.gain * DVec3::splat(0.3) + exposure.offset).element_sum() / 0.9;
        assert!(if i % 2 == 0 { grey < 0.9 } else { grey > 1.1 }, "{i}: {grey}, {exposure:?}");
    }
}

#[test]
fn poses_are_corrected() {
    let engine = common::engine();
    let (clean, points) = scene(&engine);
    let mut seen = clean.clone();
    for (i, view) in seen.iter_mut().enumerate() {
        let off = |k: usize| 0.012 * ((i * 6 + k) as f64 * 2.4).sin();
        view.pose = view.pose.stepped(&[off(0), off(1), off(2), off(3), off(4), off(5)]);
    }
    let angles = |poses: &[Pose]| -> f64 {
        poses.iter().zip(&clean).map(|(pose, view)| pose.angle_to(&view.pose)).sum()
    };
    let before = angles(&seen.iter().map(|view| view.pose).collect::<Vec<_>>());
    let options = MapOptions { correct_poses: true, ..options() };
    let mut mapper = Mapper::new(&engine, seen, &points, &options).unwrap();
    train(&mut mapper, STEPS);
    let after = angles(mapper.poses());
    assert!(after < 0.75 * before, "{before} rad before, {after} rad after");
}

#[test]
fn what_the_masks_hide_does_not_show() {
    let engine = common::engine();
    let (clean, points) = scene(&engine);
    let mut seen = clean.clone();
    for view in &mut seen {
        // The vehicle's own frame: a white bar at the left.
        let hidden = |pixel: usize| pixel % 72 < 14;
        for pixel in (0..view.camera.pixels()).filter(|pixel| hidden(*pixel)) {
            view.picture.data[3 * pixel..3 * pixel + 3].fill(255);
        }
        view.mask = Some((0..view.camera.pixels()).map(|pixel| !hidden(pixel)).collect());
    }
    let unmasked: Vec<_> =
        seen.iter().map(|view| PosedPicture { mask: None, ..view.clone() }).collect();
    let trained = |views: Vec<PosedPicture>| {
        let mut mapper = Mapper::new(&engine, views, &points, &options()).unwrap();
        train(&mut mapper, STEPS);
        psnr_of(&mut mapper, &clean)
    };
    let (with, without) = (trained(seen), trained(unmasked));
    assert!(with > without + 3.0, "{without} dB without, {with} dB with masks");
}

#[test]
fn without_points_random_ones_do() {
    let engine = common::engine();
    let (views, _) = scene(&engine);
    let mut mapper = Mapper::new(&engine, views, &[], &options()).unwrap();
    let before = psnr(&mut mapper);
    train(&mut mapper, 400);
    assert!(psnr(&mut mapper) > before);
}

#[test]
fn what_cannot_be_trained_is_refused() {
    let engine = common::engine();
    let (views, points) = scene(&engine);
    let new = |views: Vec<PosedPicture>, options: MapOptions| {
        Mapper::new(&engine, views, &points, &options).map(|_| ())
    };
    assert!(matches!(new(Vec::new(), options()), Err(MapError::NoPictures)));
    let mut other = views.clone();
    other[3].picture = Picture::new(10, 10);
    assert!(matches!(new(other, options()), Err(MapError::Size { index: 3, .. })));
    let mut other = views.clone();
    other[2].pose.translation.x = f64::NAN;
    assert!(matches!(new(other, options()), Err(MapError::Pose { index: 2 })));
    for bad in [MapOptions { splats: 0, ..options() }, MapOptions { sh_degree: 4, ..options() }] {
        assert!(matches!(new(views.clone(), bad), Err(MapError::Option { .. })));
    }
}

/// One picture, or black ones, or points in one place: a prior comes out, finite throughout.
#[test]
fn poor_pictures_give_a_finite_prior() {
    let engine = common::engine();
    let (views, points) = scene(&engine);
    let mut black = views.clone();
    black.iter_mut().for_each(|view| view.picture.data.fill(0));
    let one_place = vec![points[0]; 40];
    for (views, points) in
        [(views[..1].to_vec(), points.clone()), (black, points.clone()), (views, one_place)]
    {
        let mut mapper = Mapper::new(&engine, views, &points, &options()).unwrap();
        train(&mut mapper, 700);
        let state = mapper.state().unwrap();
        assert!(state.training.parameters.iter().all(|v| v.is_finite()));
        assert!(!mapper.splats().unwrap().positions.is_empty());
    }
}

/// What is stated beforehand is what the device then holds.
#[test]
fn memory_is_known_before_it_is_taken() {
    // An engine of its own: nothing else takes memory of it.
    let engine = Engine::new(&Default::default()).unwrap();
    let (views, points) = scene(&engine);
    for splats in [500, 30_000] {
        let options = MapOptions { splats, ..options() };
        let plan = options.plan([72, 52], Default::default());
        let stated = plan.memory(engine.device()).unwrap();
        let before = engine.memory().used;
        let mut mapper = Mapper::new(&engine, views.clone(), &points, &options).unwrap();
        // The longest copy of a state, that of its two sets of means, is there only while it is copied.
        let copy = 2 * 4 * u64::from(splats) * u64::from(nvsprior_kernels::training::planes(1));
        let taken = engine.memory().used - before + copy;
        let off = taken.abs_diff(stated.start) as f64 / taken as f64;
        assert!(off < 0.05, "{splats} splats: stated {}, taken {taken}", stated.start);
        train(&mut mapper, 30);
        let max = engine.memory().used - before + copy;
        assert!(max <= stated.peak + stated.peak / 20, "{splats} splats: {stated:?}, taken {max}");
    }
}

#[test]
fn what_does_not_fit_is_refused_with_what_would() {
    let engine = common::engine();
    let (views, points) = scene(&engine);
    let large = MapOptions { splats: 16_000_000, sh_degree: 3, ..options() };
    let [small, wide] = [[72, 52], [4096, 4096]];
    let plan = |splats, size| MapOptions { splats, ..large.clone() }.plan(size, Default::default());
    let own = engine.device();
    let refused = |splats, size, device: &DeviceInfo| {
        plan(splats, size).memory(device).map(|_| ()).unwrap_err()
    };
    let fitting = |device: &DeviceInfo| {
        let error = refused(large.splats, small, device);
        let Fits::Splats(max) = error.fits else { panic!("{error}") };
        assert!(plan(max, small).memory(device).is_ok(), "{error}");
        assert_eq!(refused(max + 1, small, device).fits, Fits::Splats(max));
        assert!(error.to_string().contains(&format!("{max} splats")), "{error}");
        error.shortage
    };
    // A device that has room for all, with one limit.
    let limited = |limit: &dyn Fn(&mut DeviceInfo)| {
        let mut device = own.clone();
        (device.storage_range, device.allocation, device.heap) = (u64::MAX, u64::MAX, u64::MAX);
        limit(&mut device);
        device
    };
    assert!(plan(large.splats, small).memory(&limited(&|_| ())).is_ok());
    let device = limited(&|device| device.storage_range = 1 << 27);
    assert!(matches!(fitting(&device), Shortage::Buffer { limit: 0x800_0000, .. }));
    let device = limited(&|device| device.allocation = 1 << 30);
    assert!(matches!(fitting(&device), Shortage::Buffer { limit: 0x4000_0000, .. }));
    let device = limited(&|device| device.heap = 2_000_000_000);
    assert!(matches!(fitting(&device), Shortage::Heap { heap: 2_000_000_000, .. }));
    let device = limited(&|device| device.workgroups = 32_767);
    assert!(matches!(fitting(&device), Shortage::Workgroups { limit: 32_767, .. }));
    // Fewer splats do not help if pictures are too large.
    let device = limited(&|device| device.storage_range = 1 << 20);
    let error = refused(500, wide, &device);
    let Fits::Width(width) = error.fits else { panic!("{error}") };
    assert!(plan(500, [width; 2]).memory(&device).is_ok());
    assert!(plan(500, [width + 1; 2]).memory(&device).is_err());
    // The mapper refuses it before it takes memory.
    if plan(large.splats, small).memory(own).is_err() {
        let error = Mapper::new(&engine, views, &points, &large).map(|_| ()).unwrap_err();
        assert!(matches!(error, MapError::NoRoom(_)), "{error}");
    }
}

/// Views of a prior, turned to the right (or left) so that they share little with those turned the other way.
fn turned_views(
    engine: &Engine,
    prior: &Prior,
    seeds: std::ops::Range<u64>,
    turn: f64,
) -> Vec<PosedPicture> {
    let camera = common::camera(72, 52);
    let scene = engine.upload(prior).unwrap();
    let mut renderer = engine.renderer(&scene, &camera, Plan::picture()).unwrap();
    let view = |seed: u64| {
        let turned = Pose::exp(&[0.0, 0.0, 0.0, 0.0, turn, 0.0]);
        let pose = common::random_pose(seed);
        let pose = Pose {
            rotation: turned.rotation * pose.rotation,
            translation: turned.rotation * pose.translation,
        };
        let mut picture = Picture::new(camera.width, camera.height);
        renderer.picture(&pose, &mut picture).unwrap();
        PosedPicture::new(camera, pose, picture)
    };
    seeds.map(view).collect()
}

#[test]
fn going_on_learns_what_is_new_and_keeps_what_is_not_shown() {
    const STEPS: u32 = 300;
    let engine = common::engine();
    let prior = common::random_prior(5, 300, 0);
    // Each third splat to the right is gone.
    let mut changed = prior.splats().clone();
    for i in (0..changed.len()).filter(|i| i % 3 == 0 && prior.splats().positions[*i][0] > 0.0) {
        changed.opacity_logits[i] = -9.0;
    }
    let now = Prior::from_splats(changed, *prior.options()).unwrap();
    let (right, left) = (-0.5, 0.5);
    let pictures = turned_views(&engine, &now, 0..12, right);
    let held_out = turned_views(&engine, &now, 20..26, right);
    let elsewhere = turned_views(&engine, &prior, 30..36, left);
    let options = MapOptions { splats: 330, schedule: Schedule::further(0.5, 0.1), ..options() };
    let trained = |memory: Vec<PosedPicture>| {
        let pictures = pictures.clone();
        let mut mapper = Mapper::going_on(&engine, &prior, pictures, memory, &options).unwrap();
        let start = [&held_out, &elsewhere].map(|views| psnr_of(&mut mapper, views));
        while mapper.steps() < STEPS {
            mapper.step(f64::from(mapper.steps()) / f64::from(STEPS)).unwrap();
        }
        (start, [&held_out, &elsewhere].map(|views| psnr_of(&mut mapper, views)))
    };
    let (before, with) = trained(turned_views(&engine, &prior, 10..22, left));
    let (_, without) = trained(Vec::new());
    assert!(with[0] > before[0] + 5.0, "what is new: {} dB before, {} after", before[0], with[0]);
    assert!(with[1] > 30.0, "what is not shown: {} dB before, {} after", before[1], with[1]);
    assert!(with[1] > without[1] + 3.0, "{} dB with memory, {} without", with[1], without[1]);
    common::assert_silent(&engine);
}
