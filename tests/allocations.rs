//! After the first frame, encoding and decoding take nothing from the heap. Nor do sender and collector.

mod common;
mod scene;

use std::alloc::System;
use std::sync::Arc;

use common::write_blocked;
use nvsprior::image::{Clahe, Preprocessing, WhiteBalance};
use nvsprior::packet::{Latent, Packet, PoseProfile, QuantisedPose, Residual, Session};
use nvsprior::prior::blocked::BlockedPrior;
use nvsprior::prior::{CoordinateFrame, KeyFrames, PriorId};
use nvsprior::render::{BlockReader, Scene};
use nvsprior::{
    Decoded, Decoder, Encoded, Encoder, EncoderOptions, Engine, Mode, Picture, Rate, Structure,
    Trust,
};
use nvsprior_link::keys::{Key, Keys};
use nvsprior_link::modem::{
    Collector, CollectorOptions, Loss, Protection, RateControlOptions, Sender, SenderOptions,
};
use scene::{CAMERA, clean_frame, pose, wall};
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Heap calls of any kind since the region's start.
fn calls(region: &Region<System>) -> usize {
    let change = region.change();
    change.allocations + change.deallocations + change.reallocations
}

/// Encodes and decodes the frames; heap calls of all but the first.
fn heap_calls(engine: &Engine, frames: &[Picture], options: EncoderOptions) -> usize {
    heap_calls_with(engine, frames, options, Preprocessing::NONE)
}

/// The same with a prior that states a preprocessing.
fn heap_calls_with(
    engine: &Engine,
    frames: &[Picture],
    options: EncoderOptions,
    preprocessing: Preprocessing,
) -> usize {
    let key_frames = KeyFrames::new((10..30).map(|t| pose(t.into())).collect()).unwrap();
    let prior = wall(1).with_key_frames(key_frames).with_preprocessing(preprocessing);
    let scene = engine.upload(&prior).unwrap();
    heap_calls_of([&scene; 2], engine, frames, options)
}

/// The same with the scene of each side.
fn heap_calls_of(
    [sent, shown]: [&Arc<Scene>; 2],
    engine: &Engine,
    frames: &[Picture],
    options: EncoderOptions,
) -> usize {
    let mut encoder = Encoder::new(engine, sent, &CAMERA, options).unwrap();
    encoder.prepare(usize::MAX).unwrap();
    let mut decoder = Decoder::new(engine, shown);
    let mut filtering = Decoder::new(engine, shown);
    filtering.set_filter(true).unwrap();
    let mut encoded = Encoded::with_room(CAMERA.width, CAMERA.height);
    let mut decoded = Decoded::default();
    let mut run = |frame, hint| {
        encoder.encode_into(frame, hint, &mut encoded).unwrap();
        decoder.decode_into(&encoded.packet, Trust::Whole, &mut decoded).unwrap();
        let half = (encoded.packet.len() / 2).max(encoded.stats.latent_bytes);
        let half = &encoded.packet[..half];
        assert!(decoded.picture == encoded.picture);
        decoder.decode_into(half, Trust::Start, &mut decoded).unwrap();
        filtering.decode_into(&encoded.packet, Trust::Whole, &mut decoded).unwrap();
    };
    run(&frames[0], Some(pose(0.0)));
    let region = Region::new(ALLOCATOR);
    frames[1..].iter().for_each(|frame| run(frame, None));
    calls(&region)
}

/// Heap calls of frames with a prior in blocks that do not change after the first frame.
fn heap_calls_in_blocks(engine: &Engine, frames: &[Picture]) -> usize {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("wall.nvsb");
    write_blocked(&path, &wall(1), 256);
    let blocked = Arc::new(BlockedPrior::open(&path).unwrap());
    let open = || engine.open_blocked(&blocked, 8 << 20, BlockReader::threaded()).unwrap();
    let [sent, shown] = [open(), open()];
    let rate = Some(Rate::Quality(60.0));
    let options = EncoderOptions { rate, ..EncoderOptions::default() };
    let calls = heap_calls_of([&sent, &shown], engine, frames, options);
    for scene in [sent, shown] {
        let residency = scene.residency().unwrap();
        assert_eq!(residency.changes, 1, "{residency:?}");
    }
    calls
}

/// A packet with a residual of 100 and some bytes that are no picture.
fn packet(frame: u32) -> Vec<u8> {
    let prior_frame = CoordinateFrame { centre: [0.0; 3], spread: 5.0 };
    let at = QuantisedPose::quantise(&pose(0.0), &prior_frame, PoseProfile::Compact).unwrap();
    let session = Session { prior: PriorId(7), camera: CAMERA };
    let latent = Latent::new(frame, &session, at, false).unwrap();
    let payload = [frame as u8 | 1; 100];
    let residual = Residual::Coded { small_blocks: false, payload: &payload };
    Packet { latent, session: None, render: None, residual, truth: None }.encode().unwrap()
}

/// Sends packets over a link that loses every third share, and brings what comes a second time, and damaged; heap calls
/// of it.
fn heap_calls_of_link(packets: &[Vec<u8>], protection: Protection, keys: Option<&Keys>) -> usize {
    let user = (protection == Protection::Layers).then_some(&b"user"[..]);
    let control = RateControlOptions {
        bit_rate: 20_000.0,
        mtu: 64,
        overhead: 0,
        latency: 1.5,
        delay: 0.3,
        spread: 0.5,
        frame_rate: 5.0,
        min_bytes: 40,
        max_shares: 16,
        loss: Loss { chance: 0.3, burst: 2.0 },
        user: user.map(<[u8]>::len),
    };
    let options = SenderOptions { control, stream: 0, protection, expect_reports: true };
    let (mut sender, mut collector) = match keys {
        None => (Sender::new(options), Collector::new(CollectorOptions::new(64))),
        Some(keys) => (
            Sender::with_keys(options, keys),
            Collector::with_keys(CollectorOptions::new(64), keys),
        ),
    };
    let (sender, collector) = (sender.as_mut().unwrap(), collector.as_mut().unwrap());
    let region = Region::new(ALLOCATOR);
    let (mut shares, mut seen) = (0, 0);
    for (k, packet) in packets.iter().enumerate() {
        let now = k as f64 / 5.0;
        if sender.plan(now).unwrap().is_some() {
            sender.push(now, packet, user).unwrap();
        }
        while let Some((_, share)) = sender.next(now) {
            shares += 1;
            if shares % 3 != 0 {
                let _ = collector.push(now, share);
                let mut damaged = [0; 64];
                damaged[..share.len()].copy_from_slice(share);
                let _ = collector.push(now, &damaged[..share.len()]);
                damaged[5] ^= 1;
                let _ = collector.push(now, &damaged[..share.len()]);
            }
        }
        if k % 5 == 4
            && let Some(report) = collector.report(0, |_| false).unwrap()
        {
            let mut bytes = [0; 200];
            let len = collector.write_report(&report, None, &mut bytes).unwrap();
            let (report, _) = sender.read_report(&bytes[..len]).unwrap();
            sender.process_report(now, &report).unwrap();
        }
        seen += usize::from(collector.newest(0).is_some_and(|packet| packet.arrived > 0));
    }
    let calls = calls(&region);
    let counts = collector.statistics();
    let repaired = protection == Protection::None || counts.repaired > 50;
    assert!(seen > 100 && repaired && counts.completed > 20, "{counts:?}");
    calls
}

// One test, so that no other thread allocates meanwhile.
#[test]
fn frames_after_the_first_take_nothing_from_the_heap() {
    // Not under the validation layer, which is not what is measured.
    let engine = Engine::new(&Default::default()).unwrap();
    let scene = engine.upload(&wall(1)).unwrap();
    let frames: Vec<_> = (0..4).map(|t| clean_frame(&engine, &scene, &pose(t.into()))).collect();
    let region = Region::new(ALLOCATOR);
    drop(vec![0u8; 100]);
    assert_eq!(calls(&region), 2, "the counter counts");
    let packets: Vec<_> = (0..200).map(packet).collect();
    let keys = Keys::new([1, 2].map(|byte| Key::new([byte; 32]))).unwrap();
    for protection in [Protection::Layers, Protection::None] {
        for keys in [None, Some(&keys)] {
            let calls = heap_calls_of_link(&packets, protection, keys);
            assert_eq!(calls, 0, "{protection:?}, {keys:?}, from the first packet on");
        }
    }
    for rate in [None, Some(Rate::Quality(60.0)), Some(Rate::Bytes(300)), Some(Rate::Psnr(36.0))] {
        let options = EncoderOptions { rate, camera_interval: 2, ..EncoderOptions::default() };
        assert_eq!(heap_calls(&engine, &frames, options), 0, "{rate:?}");
    }
    assert_eq!(heap_calls_in_blocks(&engine, &frames), 0, "a prior in blocks");
    for structure in [Structure::Chain { key_every: 2 }, Structure::Keys { key_every: 0 }] {
        let rate = Some(Rate::Quality(60.0));
        let mode = Mode::Stream(structure);
        let options = EncoderOptions { rate, mode, ..EncoderOptions::default() };
        assert_eq!(heap_calls(&engine, &frames, options), 0, "{structure:?}");
    }
    let (white_balance, clahe) = (WhiteBalance::GrayWorld, Some(Clahe::default()));
    let treated = Preprocessing { white_balance, clahe };
    let options = EncoderOptions::default();
    assert_eq!(heap_calls_with(&engine, &frames, options, treated), 0, "treated frames");
    // A frame of another scene: the encoder looks for it by key frames.
    let foreign = clean_frame(&engine, &engine.upload(&wall(2)).unwrap(), &pose(0.0));
    let lost = [&frames[0], &foreign, &foreign, &frames[1]].map(Picture::clone);
    assert_eq!(heap_calls(&engine, &lost, EncoderOptions::default()), 0, "lost frames");
}
