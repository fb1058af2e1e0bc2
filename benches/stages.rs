//! Measures the time of a frame's steps, on the tests' wall and, if its data lies beside the
//! project, on the reef: `cargo bench --bench stages`.

#[path = "../tests/common/mod.rs"]
mod common;
#[path = "../tests/scene/mod.rs"]
mod scene;

use std::hint::black_box;
use std::sync::Arc;

use criterion::{Criterion, criterion_group, criterion_main};
use nvsprior::image::{Clahe, Preprocessing, Preprocessor, WhiteBalance};
use nvsprior::packet::{Latent, PoseProfile, QuantisedPose, Session};
use nvsprior::prior::ply::write_ply;
use nvsprior::render::{Jacobian, Plan, Scene};
use nvsprior::residual::{ResidualDecoder, ResidualEncoder, ResidualSetup};
use nvsprior::vulkan::DeviceOptions;
use nvsprior::{Camera, Engine, Packet, Picture, Pose, Prior, Rate};
use nvsprior_link::keys::{Authenticator, Content, Key, Keys, Verifier};

/// A prior and a place to look at it from.
struct PriorView {
    name: &'static str,
    prior: Prior,
    camera: Camera,
    pose: Pose,
}

fn scenes() -> Vec<PriorView> {
    let wall = PriorView {
        name: "wall",
        prior: scene::wall(1),
        camera: scene::CAMERA,
        pose: scene::pose(0.0),
    };
    let reef = common::reef_prior().map(|prior| {
        let (camera, pose) = (common::REEF_CAMERA, common::reef_pose());
        PriorView { name: "reef", prior, camera, pose }
    });
    std::iter::once(wall).chain(reef).collect()
}

/// Without validation, which would be measured too.
fn engine() -> Engine {
    Engine::new(&DeviceOptions::default()).expect("a Vulkan device")
}

/// Pictures and normal equations at full resolution, submission and wait included.
fn render(criterion: &mut Criterion) {
    let engine = engine();
    for PriorView { name, prior, camera, pose } in scenes() {
        let scene = engine.upload(&prior).expect("room for the prior");
        let jacobians = vec![Jacobian::Flow, Jacobian::Exact];
        let plan = Plan { jacobians, ..Plan::picture() };
        let mut renderer = engine.renderer(&scene, &camera, plan).expect("a renderer");
        let frame = common::random_frame(1, &camera);
        renderer.set_frame(0, &frame);
        let mut group = criterion.benchmark_group(format!("render {name}"));
        group.bench_function("picture", |b| b.iter(|| renderer.draw(&pose).expect("a picture")[0]));
        for (kind, jacobian) in [("flow", Jacobian::Flow), ("exact", Jacobian::Exact)] {
            group.bench_function(format!("normal equations, {kind}"), |b| {
                b.iter(|| renderer.normal_equations(0, jacobian, &pose).expect("sums").mse())
            });
        }
        group.finish();
    }
}

/// What the camera saw, and the render at the right pose.
fn camera_and_render(engine: &Engine, scene: &Arc<Scene>) -> (Picture, Picture) {
    let pose = scene::pose(0.0);
    let mut render = Picture::new(scene::CAMERA.width, scene::CAMERA.height);
    let mut renderer = engine.renderer(scene, &scene::CAMERA, Plan::picture()).expect("a renderer");
    renderer.picture(&pose, &mut render).expect("a render");
    (scene::frame(engine, scene, &pose), render)
}

/// Difference pictures and packets of the wall.
fn code(criterion: &mut Criterion) {
    let engine = engine();
    let scene = engine.upload(&scene::wall(1)).expect("room for the prior");
    let (camera, render) = camera_and_render(&engine, &scene);
    let quality = Rate::Quality(10.0);
    let (width, height) = (camera.width, camera.height);
    let setup = ResidualSetup::new(width, height);
    let mut encoder = ResidualEncoder::new(&setup);
    let mut group = criterion.benchmark_group("residual wall");
    for (name, rate) in [("quality 10", quality), ("300 bytes", Rate::Bytes(300))] {
        group.bench_function(format!("encode, {name}"), |b| {
            b.iter(|| {
                let coded = encoder.encode(black_box(&camera), &render, rate, 0);
                coded.expect("a residual").psnr
            })
        });
    }
    let coded = encoder.encode(&camera, &render, quality, 0).expect("a coded residual");
    let mut decoder = ResidualDecoder::new(width, height, &setup.tables);
    group.bench_function("decode", |b| {
        let mut picture = render.clone();
        b.iter(|| {
            picture.clone_from(black_box(&render));
            decoder.add(&coded.residual, true, &mut picture)
        })
    });
    group.finish();

    let pose =
        QuantisedPose::quantise(&scene::pose(0.0), &scene.coordinate_frame(), PoseProfile::Compact);
    let session = Session { prior: scene.id(), camera: scene::CAMERA };
    let latent = Latent::new(0, &session, pose.expect("a pose in range"), false)
        .expect("a camera that fits a packet");
    let (session, residual) = (Some(session), coded.residual);
    let packet = Packet { latent, session, render: None, residual, truth: None };
    let bytes = packet.encode().expect("a packet");
    let mut group = criterion.benchmark_group("packet");
    group.bench_function("encode", |b| b.iter(|| black_box(&packet).encode()));
    group.bench_function("decode", |b| b.iter(|| Packet::decode(black_box(&bytes))));
    group.finish();
}

/// White balance and CLAHE of a frame of 320×180.
fn preprocess(criterion: &mut Criterion) {
    let mut random = nvsprior::random::Random::new(1);
    let mut frame = Picture::new(320, 180);
    frame.data.fill_with(|| random.within(5.0, 60.0) as u8);
    let mut treated = frame.clone();
    let mut group = criterion.benchmark_group("preprocessing 320×180");
    let (balance, clahe) = (WhiteBalance::GrayWorld, Some(Clahe::default()));
    for (name, white_balance, clahe) in [
        ("white balance", balance, None),
        ("CLAHE", WhiteBalance::None, clahe),
        ("both", balance, clahe),
    ] {
        let mut preprocessor = Preprocessor::new(&Preprocessing { white_balance, clahe });
        group.bench_function(name, |b| {
            b.iter(|| {
                treated.clone_from(black_box(&frame));
                preprocessor.apply(&mut treated);
            })
        });
    }
    group.finish();
}

/// Tags of a modem frame of 64 bytes: making and checking one, and refusing a stranger's with one key and with four.
fn keys(criterion: &mut Criterion) {
    let of = |bytes: &[u8]| Keys::new(bytes.iter().map(|byte| Key::new([*byte; Key::LEN])));
    let (one, four) = (of(&[1]).expect("a key"), of(&[1, 2, 3, 4]).expect("four keys"));
    let strange = of(&[9]).expect("a key");
    let (content, mut frame, mut forged) = ([0x5A; 58], Vec::new(), Vec::new());
    Authenticator::new(&strange, Content::Frame).write(0, &content, &mut forged);
    let mut group = criterion.benchmark_group("keys, 64 bytes");
    let mut authenticator = Authenticator::new(&one, Content::Frame);
    let mut make = |frame: &mut Vec<u8>| authenticator.write(0, black_box(&content), frame);
    group.bench_function("make", |b| b.iter(|| make(&mut frame)));
    // Both count from 0.
    let mut authenticator = Authenticator::new(&one, Content::Frame);
    let mut verifier = Verifier::new(&one, Content::Frame);
    group.bench_function("make and check", |b| {
        b.iter(|| {
            authenticator.write(0, black_box(&content), &mut frame);
            verifier.verify(black_box(&frame)).map(|verified| verified.number).expect("its own")
        })
    });
    for (name, keys) in [("refuse, one key", &one), ("refuse, four keys", &four)] {
        let mut verifier = Verifier::new(keys, Content::Frame);
        group.bench_function(format!("{name}, at first"), |b| {
            b.iter(|| verifier.verify(black_box(&forged)).is_err())
        });
        let mut sender = Authenticator::new(keys, Content::Frame);
        sender.write(0, &content, &mut frame);
        assert!(verifier.verify(&frame).is_ok());
        group.bench_function(name, |b| b.iter(|| verifier.verify(black_box(&forged)).is_err()));
    }
    group.finish();
}

/// Reading a prior's file, checks and identity included.
fn load(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("load");
    group.sample_size(20);
    for PriorView { name, prior, .. } in scenes() {
        let mut bytes = Vec::new();
        write_ply(
            prior.splats(),
            prior.options(),
            prior.key_frames(),
            prior.preprocessing(),
            &mut bytes,
        )
        .expect("a file in memory");
        group.bench_function(name, |b| {
            b.iter(|| {
                Prior::from_bytes(black_box(&bytes), name, &Default::default()).expect("a prior")
            })
        });
    }
    group.finish();
}

criterion_group!(benches, render, code, preprocess, keys, load);
criterion_main!(benches);
