//! Stages of a frame that have one form, with subgroups of 32: against the host, or the device at hand.

use bytemuck::Zeroable;
use glam::DVec3;

use nvsprior::tracking::{GaussNewtonOptions, Pyramid};
use nvsprior::{Camera, Picture, residual};
use nvsprior_emulator::{Dispatch, Module};
use nvsprior_kernels::filter::FilterLayer;
use nvsprior_kernels::modules;
use nvsprior_kernels::portable::sample;
use nvsprior_kernels::search::{
    self, Anchor, COMPACT, Placement, Program, Search, placed, set_pose,
};
use nvsprior_kernels::shared::{
    CULLED, DERIVATIVES, GROUP, Groups, Params, PyramidLevel, PyramidLevels,
};
use nvsprior_reference::probe::{Probe, SortPrecision};

use crate::chain::{Chain, Form, Settings, View};
use crate::common::{self, Random, camera, random_frame, random_pose, random_prior};

const FORM: Form = Form { subgroup: 32, wave: true };

fn noise(seed: u64, camera: &Camera) -> Picture {
    let data = random_frame(seed, camera).iter().map(|v| nvsprior::render::to_byte(*v)).collect();
    Picture { width: camera.width, height: camera.height, data }
}

/// Bytes as words, with zeros at the end.
fn words(bytes: &[u8], count: usize) -> Vec<u32> {
    let mut padded = bytes.to_vec();
    padded.resize(4 * count, 0);
    bytemuck::pod_collect_to_vec(&padded)
}

#[test]
fn arithmetic() {
    let mut random = Random::new(160);
    let numbers: Vec<[f32; 3]> = (0..256)
        .map(|_| [random.within(0.01, 9.0), random.within(-5.0, 5.0), random.within(-9.0, 9.0)])
        .collect();
    let expected = numbers.iter().flat_map(|[a, b, c]| sample(*a, *b, *c).map(f32::to_bits));
    let expected: Vec<u32> = expected.collect();
    let mut buffers = [bytemuck::pod_collect_to_vec(&numbers), vec![0; expected.len()]];
    let dispatch = Dispatch { groups: [4, 1, 1], push: &[], constants: &[], subgroup: 32, seed: 1 };
    let module = Module::new(modules::arithmetic.spirv).unwrap();
    module.run(&dispatch, &mut buffers).unwrap();
    assert!(buffers[1] == expected);
}

#[test]
fn quantize_rgb8() {
    let prior = random_prior(161, 400, 1);
    let camera = camera(45, 31);
    let view = View::new(&prior, camera, random_pose(161));
    let pixels = camera.pixels();
    let room = pixels.div_ceil(4) * 3;
    let frame = noise(161, &camera);
    let mut chain = Chain::new(&view, Settings::new(FORM, 1));
    chain.set("image", &view.drawn.image);
    chain.set("frame bytes", &words(&frame.data, room));
    chain.set("render", &vec![u32::MAX; room]);
    chain.set("difference", &vec![u32::MAX; room]);
    let names = ["params", "image", "render", "frame bytes", "difference"];
    chain.run(&modules::quantize_rgb8, Groups::of(&chain.params).byte_words, &[1], &names);
    assert!(chain.get::<u8>("render")[..3 * pixels] == view.drawn.rgb8);
    let render = Picture { data: view.drawn.rgb8.clone(), ..frame.clone() };
    let expected = residual::difference(&frame, &render).data;
    assert!(chain.get::<u8>("difference")[..3 * pixels] == expected);
}

#[test]
fn pyramid() {
    const FACTORS: [u32; 3] = [1, 2, 4];
    let prior = random_prior(162, 8, 0);
    let camera = camera(70, 43);
    let view = View::new(&prior, camera, random_pose(162));
    let frame = noise(162, &camera);
    let mut host = Pyramid::new(&camera, &FACTORS);
    host.set(&frame);
    let mut levels =
        PyramidLevels { frame_width: camera.width, count: 3, ..PyramidLevels::default() };
    for (to, factor) in levels.levels.iter_mut().zip(FACTORS) {
        let Camera { width, height, .. } = camera.reduced(factor);
        *to = PyramidLevel { width, height, factor };
    }
    let floats: Vec<f32> = (0..3).flat_map(|level| host.level(level).to_vec()).collect();
    let mut chain = Chain::new(&view, Settings::new(FORM, 1));
    chain.set("bytes", &words(&frame.data, (3 * camera.pixels()).div_ceil(4)));
    chain.set("frame", &vec![f32::NAN; floats.len()]);
    chain.set("light", &[1.0_f32, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    chain.set("mask", &vec![0_u32; 1 + camera.pixels().div_ceil(32)]);
    let groups: u32 = levels.levels.iter().map(|level| level.pixels().div_ceil(GROUP)).sum();
    let groups = [groups.div_ceil(2), 2, 1];
    let names = ["bytes", "frame", "light", "mask"];
    chain.run(&modules::pyramid, groups, bytemuck::cast_slice(&[levels]), &names);
    for (got, expected) in chain.get::<f32>("frame").iter().zip(&floats) {
        assert!((got - expected).abs() <= 1e-6, "{got}, host {expected}");
    }
}

/// As the device at hand leaves them.
#[test]
fn pose_jacobian() {
    let engine = common::engine();
    let prior = random_prior(163, 700, 2);
    let view = View::new(&prior, camera(60, 45), random_pose(163));
    let mut chain = Chain::new(&view, Settings::new(FORM, 1));
    chain.set("derivatives", &vec![0_u32; 4 * (DERIVATIVES * (chain.params.splats + 1)) as usize]);
    chain.project();
    let names = ["params", "geometry", "sh", "records", "keys", "derivatives"];
    chain.run(&modules::pose_jacobian, Groups::of(&chain.params).splats, &[], &names);
    let scene = engine.upload(&prior).unwrap();
    let exact = SortPrecision::Exact;
    let device =
        Probe::of(&engine).stages(&scene, &view.camera, &view.pose, 1 << 16, exact).unwrap();
    assert!(chain.buffers["keys"] == device.keys);
    let seen = |i: &usize| device.keys[*i] != CULLED;
    let seen: Vec<usize> = (0..device.keys.len()).filter(seen).collect();
    assert!(seen.len() > 100);
    for i in seen {
        let got = &chain.get::<[f32; 4 * DERIVATIVES as usize]>("derivatives")[i];
        let size = device.derivatives[i].iter().fold(1.0, |m: f32, v| m.max(v.abs()));
        for (got, expected) in got.iter().zip(&device.derivatives[i]) {
            assert!((got - expected).abs() <= 1e-4 * size, "splat {i}: {got}, device {expected}");
        }
    }
}

/// One step of a search, and the last one, against the host's.
#[test]
fn solve() {
    let prior = random_prior(164, 500, 1);
    let (camera, pose) = (camera(48, 36), random_pose(164));
    let view = View::new(&prior, camera, pose);
    let centre = DVec3::from(prior.coordinate_frame().centre.map(f64::from));
    let at = pose.translation + pose.rotation * centre;
    let start = Placement {
        rotation: pose.wxyz().map(|v| v as f32),
        translation: at.to_array().map(|v| v as f32),
    };
    let cold = GaussNewtonOptions::default().cold.program(1, [start], 1e-3, COMPACT);
    for renders in [1, 5] {
        let mut chain = Chain::new(&view, Settings::new(FORM, 1));
        chain.set("frame", &random_frame(164, &camera));
        chain.tile_lists();
        chain.equations();
        let mut host = Search {
            program: Program { renders, leap: 0.0, tolerance: 0.0, ..cold },
            ..Search::zeroed()
        };
        search::begin(&mut host);
        let anchor = Anchor { centre: [0.1, 0.2, 0.3], step: 1e-3 };
        chain.set("levels", &[chain.params; 2]);
        chain.set("search", &[host]);
        chain.set("groups", &[Groups::NONE; 2]);
        chain.set("coded", &[0_u32; 12]);
        chain.buffers.get_mut("coded").unwrap()[..4]
            .copy_from_slice(bytemuck::cast_slice(&[anchor]));
        let before = chain.params;
        let names = ["levels", "search", "partials", "params", "groups", "counters", "coded"];
        chain.run(&modules::solve, [1, 1, 1], &[], &names);
        let got = chain.get::<Search>("search")[0];
        host.pairs_needed = chain.buffers["counters"][0];
        assert_eq!(bytemuck::cast_slice::<f32, u32>(&got.sums), chain.buffers["sums"]);
        host.sums = got.sums;
        search::advance(&mut host);
        assert_eq!(
            (got.phase, got.stop, got.evaluations),
            (host.phase, host.stop, host.evaluations)
        );
        assert_eq!(got.phase == search::FOUND, renders == 1);
        let params = chain.get::<Params>("params")[0];
        let groups = chain.get::<Groups>("groups");
        if got.phase == search::FOUND {
            assert_near(&got.found, &host.found);
            let code = *bytemuck::from_bytes(&chain.get::<u8>("coded")[16..48]);
            assert_near(&placed(&code, &anchor), &host.found);
            assert_eq!((params, groups), (before, &[Groups::NONE, Groups::of(&before)][..]));
        } else {
            assert_near(&got.trial, &host.trial);
            let mut next = before;
            set_pose(&mut next, &got.trial);
            let close = |(a, b): (&f32, &f32)| (a - b).abs() < 1e-5;
            assert!(params.rotation.iter().zip(&next.rotation).all(close));
            assert_eq!(groups, &[Groups::of(&before), Groups::NONE]);
        }
    }
}

fn assert_near(got: &Placement, expected: &Placement) {
    let got = got.rotation.iter().chain(&got.translation);
    for (got, expected) in got.zip(expected.rotation.iter().chain(&expected.translation)) {
        assert!((got - expected).abs() < 2e-3, "{got}, host {expected}");
    }
}

#[test]
fn filter_layer() {
    const WORDS: usize = 4;
    const SIZE: [usize; 2] = [35, 11];
    const DILATION: isize = 2;
    const OUTPUTS: usize = 16;
    let mut random = Random::new(170);
    let count = SIZE[0] * SIZE[1];
    let mut whole = |most: f32| random.within(-most, most).round() as i32;
    let inputs: Vec<u8> = (0..4 * WORDS * count).map(|_| (whole(127.4) + 128) as u8).collect();
    let weights: Vec<i32> = (0..OUTPUTS * 9 * 4 * WORDS).map(|_| whole(127.0)).collect();
    let biases: Vec<i32> = (0..OUTPUTS).map(|_| whole(100_000.0)).collect();
    let scale = 1.0 / 2048.0;
    // The device's weights: by group of eight outputs, tap and input; here they are taken to lie so.
    let weight = |output: usize, tap: usize, input: usize| {
        weights[((output / 8 * 9 + tap) * 4 * WORDS + input) * 8 + output % 8]
    };
    let expected = |output: usize, at: usize| {
        let [x, y] = [(at % SIZE[0]) as isize, (at / SIZE[0]) as isize];
        let mut sum = biases[output];
        for tap in 0..9 {
            let [across, down] =
                [tap as isize % 3 - 1, tap as isize / 3 - 1].map(|by| by * DILATION);
            let column = (x + across).clamp(0, SIZE[0] as isize - 1) as usize;
            let row = (y + down).clamp(0, SIZE[1] as isize - 1) as usize;
            for input in 0..4 * WORDS {
                let byte = inputs[4 * (input / 4 * count + row * SIZE[0] + column) + input % 4];
                sum += weight(output, tap, input) * i32::from(byte);
            }
        }
        (sum >> 11).clamp(0, 255) as u8
    };
    let bits =
        |values: &mut dyn Iterator<Item = f32>| -> Vec<u32> { values.map(f32::to_bits).collect() };
    let ends = (0..2).flat_map(|group| {
        let own = biases[8 * group..8 * group + 8].iter().map(|bias| *bias as f32);
        own.chain([scale; 8]).collect::<Vec<_>>()
    });
    let mut buffers = [
        bytemuck::pod_collect_to_vec(&inputs),
        bits(&mut weights.iter().map(|weight| *weight as f32)),
        bits(&mut ends.into_iter()),
        vec![u32::MAX; OUTPUTS / 4 * count],
    ];
    let layer = FilterLayer {
        width: SIZE[0] as u32,
        height: SIZE[1] as u32,
        words: WORDS as u32,
        dilation: DILATION as u32,
        weights: 0,
        ends: 0,
    };
    let groups = [SIZE[0].div_ceil(32) as u32, SIZE[1].div_ceil(8) as u32, 2];
    let dispatch = Dispatch { groups, push: &layer.words(), constants: &[], subgroup: 32, seed: 1 };
    Module::new(modules::filter_layer.spirv).unwrap().run(&dispatch, &mut buffers).unwrap();
    let found: Vec<u8> = bytemuck::pod_collect_to_vec(&buffers[3]);
    for at in 0..count {
        for output in 0..OUTPUTS {
            let byte = found[4 * (output / 4 * count + at) + output % 4];
            assert_eq!(byte, expected(output, at), "output {output} of block {at}");
        }
    }
}
