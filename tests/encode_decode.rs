//! Frames in, packets out, pictures back, through the public API.

mod common;
mod scene;

use std::sync::Arc;

use common::assert_silent;
use nvsprior::packet::{
    Latent, PacketError, PoseProfile, QuantisedPose, RenderCheck, Residual, Session,
};
use nvsprior::random::Random;
use nvsprior::render::{Plan, Scene};
use nvsprior::tracking::StartKind;
use nvsprior::{
    Camera, Decoder, Encoded, Encoder, EncoderOptions, Engine, Error, FrameInfo, Hint, Packet,
    Picture, Pipeline, Pose, PriorId, Rate, RenderChecks,
};
use scene::{CAMERA, clean_frame, frame, on_device, pose, pose_error, wall};

const OFFSET: [f64; 6] = [0.05, -0.04, 0.06, 0.02, -0.03, 0.02];

#[test]
fn a_dive_comes_back_as_the_encoder_predicted() {
    let (engine, scene) = on_device(&wall(1));
    let mut encoder = Encoder::new(&engine, &scene, &CAMERA, EncoderOptions::default()).unwrap();
    let mut decoder = Decoder::new(&engine, &scene);
    for t in 0..4u8 {
        let truth = pose(t.into());
        let frame = clean_frame(&engine, &scene, &truth);
        let start = (t == 0).then(|| truth.stepped(&OFFSET));
        let encoded = encoder.encode(&frame, start).unwrap();
        assert!(pose_error(&encoded.pose, &truth) < 0.3, "frame {t}: {:?}", encoded.stats);
        assert!(encoded.stats.psnr > encoded.stats.render_psnr);
        assert_eq!(encoded.stats.latent_bytes, if t == 0 { 24 } else { 20 });
        let decoded = decoder.decode(&encoded.packet).unwrap();
        assert_eq!(decoded.picture, encoded.picture, "frame {t}");
        assert_eq!(decoded.frame, u32::from(t));
        assert!(decoded.damage.is_none());
    }
    assert_silent(&engine);
}

/// Frames side by side: the same packets, one call later.
#[test]
fn a_pipeline_gives_the_same_packets() {
    let (engine, scene) = on_device(&wall(6));
    let frames: Vec<_> = (0..4).map(|t| frame(&engine, &scene, &pose(t.into()))).collect();
    let encoder = || Encoder::new(&engine, &scene, &CAMERA, EncoderOptions::default()).unwrap();
    let mut alone = encoder();
    let start = |t: usize| (t == 0).then(|| pose(0.0).stepped(&OFFSET));
    let mut pipeline = Pipeline::new(encoder());
    let mut encoded = Encoded::default();
    let mut packets = Vec::new();
    for (t, frame) in frames.iter().enumerate() {
        assert_eq!(pipeline.push(frame, start(t), &mut encoded).unwrap(), t > 0);
        if t > 0 {
            packets.push(encoded.packet.clone());
        }
    }
    // What cannot be refined is left out, and what is under way still comes.
    let small = Picture::new(8, 8);
    let refused = pipeline.push(&small, None, &mut encoded);
    assert!(matches!(refused, Err(Error::FrameSize { .. })));
    assert!(pipeline.flush(&mut encoded).unwrap());
    packets.push(encoded.packet.clone());
    assert!(!pipeline.flush(&mut encoded).unwrap());
    for (t, (frame, packet)) in frames.iter().zip(&packets).enumerate() {
        assert_eq!(alone.encode(frame, start(t)).unwrap().packet, *packet, "frame {t}");
    }
    // If a difference cannot be coded, the next call says so, and only that frame is lost.
    pipeline.encoder().set_rate(Some(Rate::Bytes(5)));
    assert!(!pipeline.push(&frames[3], None, &mut encoded).unwrap());
    pipeline.encoder().set_rate(None);
    let failed = pipeline.push(&frames[3], None, &mut encoded);
    assert!(matches!(failed, Err(Error::Budget { budget: 5, .. })), "{failed:?}");
    assert!(pipeline.flush(&mut encoded).unwrap());
    assert_silent(&engine);
}

/// On the device the frame before is always tried first. The outcome shows a jump.
#[test]
fn a_jump_is_looked_for_afresh() {
    let (engine, scene) = on_device(&wall(3));
    let far = 60.0;
    let frames: Vec<_> =
        [0.0, 1.0, far, far + 1.0].iter().map(|t| frame(&engine, &scene, &pose(*t))).collect();
    let run = |external: Option<Pose>| {
        let options = EncoderOptions { rate: None, ..EncoderOptions::default() };
        let mut encoder = Encoder::new(&engine, &scene, &CAMERA, options).unwrap();
        let starts = [Some(pose(0.0)), None, external, None];
        let encode = |(frame, start)| encoder.encode(frame, start).unwrap();
        frames.iter().zip(starts).map(encode).collect::<Vec<_>>()
    };
    let told = run(Some(pose(far + 1.0)));
    let kinds: Vec<_> = told.iter().map(|e| e.stats.start).collect();
    assert_eq!(kinds[..3], [StartKind::External, StartKind::Previous, StartKind::External]);
    assert_ne!(kinds[3], StartKind::External);
    let mut renderer = engine.renderer(&scene, &CAMERA, Plan::picture()).unwrap();
    let mut render = Picture::new(CAMERA.width, CAMERA.height);
    for ((encoded, frame), t) in told.iter().zip(&frames).zip([0.0, 1.0, far, far + 1.0]) {
        renderer.picture(&pose(t), &mut render).unwrap();
        assert!(encoded.stats.render_psnr > render.psnr(frame) - 0.1, "{:?}", encoded.stats);
    }
    let untold = run(None);
    assert_eq!(untold[1].stats.submissions, 1);
    if untold[2].stats.render_psnr < 20.0 {
        assert_eq!(untold[2].stats.start, StartKind::BestOfBad);
        assert!(Latent::decode(&untold[2].packet).unwrap().uncertain);
    }
    assert_silent(&engine);
}

/// After steady frames a search begins at a fine level, which a jump leads astray.
#[test]
fn a_jump_after_steady_frames_ends_near_the_best_pose() {
    let (engine, scene) = on_device(&wall(3));
    let options = EncoderOptions { rate: None, ..EncoderOptions::default() };
    let mut encoder = Encoder::new(&engine, &scene, &CAMERA, options).unwrap();
    let mut renderer = engine.renderer(&scene, &CAMERA, Plan::picture()).unwrap();
    let mut render = Picture::new(CAMERA.width, CAMERA.height);
    for jump in (3..20).map(f64::from) {
        encoder.reset();
        for t in [0.0, 0.2, 0.4, 0.6, 0.8, 0.8 + jump] {
            let frame = frame(&engine, &scene, &pose(t));
            let start = (t == 0.0).then(|| pose(t));
            let stats = encoder.encode(&frame, start).unwrap().stats;
            renderer.picture(&pose(t), &mut render).unwrap();
            let best = render.psnr(&frame);
            assert!(stats.render_psnr > best - 0.7, "{jump}, {t}: {best:.2} dB, {stats:?}");
        }
    }
}

#[test]
fn the_first_frame_needs_a_pose_and_a_failed_frame_changes_nothing() {
    let (engine, scene) = on_device(&wall(4));
    let mut encoder = Encoder::new(&engine, &scene, &CAMERA, EncoderOptions::default()).unwrap();
    let picture = frame(&engine, &scene, &pose(0.0));
    assert!(matches!(encoder.encode(&picture, None), Err(Error::NoStart { frame: 0 })));
    let nan = Pose { translation: glam::DVec3::NAN, ..pose(0.0) };
    assert!(matches!(encoder.encode(&picture, Some(nan)), Err(Error::HintPose { frame: 0 })));
    let other = Picture::new(8, 8);
    assert!(matches!(encoder.encode(&other, Some(pose(0.0))), Err(Error::FrameSize { .. })));
    assert_eq!(encoder.encode(&picture, Some(pose(0.0))).unwrap().stats.frame, 0);
}

/// Impossible statements are refused before the frame is looked at. The next packet is as if the frame had never come.
#[test]
fn what_is_stated_of_a_frame_is_checked() {
    let (engine, scene) = on_device(&wall(4));
    let encoder = || Encoder::new(&engine, &scene, &CAMERA, EncoderOptions::default()).unwrap();
    let frames = [0.0, 1.0].map(|t| frame(&engine, &scene, &pose(t)));
    let sure = Hint::with_deviation(pose(0.0), &[0.01; 6]).unwrap();
    let at = |hint, time| FrameInfo { hint, time: Some(time) };
    let valid = [at(Some(Hint { age: 0.1, ..sure }), 5.0), at(None, 5.5)];
    let mut plain = encoder();
    let expected = [0, 1].map(|t| plain.encode(&frames[t], valid[t]).unwrap().packet);

    let mut encoder = encoder();
    assert_eq!(encoder.encode(&frames[0], valid[0]).unwrap().packet, expected[0]);
    let mut covariance = sure.covariance.unwrap();
    covariance[0][1] = 1.0;
    let none = Hint { covariance: Some(covariance), ..sure };
    let before = encoder.trace().to_vec();
    for (known, named) in [
        (at(None, 4.0), "5 s"),
        (at(None, f64::NAN), "NaN s"),
        (none.into(), "covariance"),
        (Hint { age: -1.0, ..sure }.into(), "-1 s old"),
    ] {
        let error = encoder.encode(&frames[1], known).unwrap_err().to_string();
        assert!(error.starts_with("frame 1: ") && error.contains(named), "{error}");
    }
    assert_eq!(encoder.trace().len(), before.len(), "no work was done");
    assert_eq!(encoder.encode(&frames[1], valid[1]).unwrap().packet, expected[1]);

    let mut pipeline = Pipeline::new(encoder);
    let mut encoded = Encoded::default();
    let back = pipeline.push(&frames[1], at(None, 4.0), &mut encoded);
    assert!(matches!(back, Err(Error::FrameTimeBack { frame: 2, time: 4.0, before: 5.5 })));
}

/// The last stated time counts, whichever frames came after it. A reset forgets it with the frames.
#[test]
fn a_reset_forgets_the_frames_before() {
    let (engine, scene) = on_device(&wall(4));
    let options = EncoderOptions { rate: None, ..EncoderOptions::default() };
    let mut encoder = Encoder::new(&engine, &scene, &CAMERA, options).unwrap();
    let picture = frame(&engine, &scene, &pose(0.0));
    let at = |time| FrameInfo { hint: Some(Hint::of(pose(0.0))), time: Some(time) };
    encoder.encode(&picture, at(5.0)).unwrap();
    assert_eq!(encoder.encode(&picture, None).unwrap().packet.len(), 20);
    assert!(matches!(encoder.encode(&picture, at(4.0)), Err(Error::FrameTimeBack { .. })));
    encoder.reset();
    assert!(matches!(encoder.encode(&picture, None), Err(Error::NoStart { frame: 2 })));
    let afresh = encoder.encode(&picture, at(4.0)).unwrap();
    assert_eq!((afresh.stats.frame, afresh.stats.start), (2, StartKind::External));
    assert_eq!(afresh.packet.len(), 49, "the session is stated again");
}

/// Grey water: noise about a value.
fn silt(value: f64, seed: u64) -> Picture {
    let mut picture = Picture::new(CAMERA.width, CAMERA.height);
    let mut state = seed;
    for byte in &mut picture.data {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        *byte = (value + (state >> 33) as f64 / f64::from(1_u32 << 31) * 8.0) as u8;
    }
    picture
}

/// A frame's statistics and its packet agree on whether it is certain. Uncertain frames are counted.
#[test]
fn frames_that_are_not_certain_are_counted() {
    let (engine, scene) = on_device(&wall(3));
    let options = EncoderOptions { rate: None, ..EncoderOptions::default() };
    let mut encoder = Encoder::new(&engine, &scene, &CAMERA, options).unwrap();
    let (clear, grey) = (frame(&engine, &scene, &pose(0.0)), silt(110.0, 1));
    let lost = |encoder: &mut Encoder, picture: &Picture| {
        let told = Some(pose(0.0));
        let Encoded { stats, packet, .. } = encoder.encode(picture, told).unwrap();
        assert_eq!(stats.certain, stats.frames_since_certain == 0);
        assert_eq!(Latent::decode(&packet).unwrap().uncertain, !stats.certain);
        stats.frames_since_certain
    };
    let run = [&clear, &grey, &grey, &clear, &grey].map(|picture| lost(&mut encoder, picture));
    assert_eq!(run, [0, 1, 2, 0, 1]);
    // A frame that cannot be encoded is none.
    assert!(encoder.encode(&Picture::new(8, 8), None).is_err());
    assert_eq!(lost(&mut encoder, &grey), 2);
    encoder.reset();
    assert_eq!([&clear, &grey].map(|picture| lost(&mut encoder, picture)), [0, 1]);
}

/// Within how much a position is known comes with each packet, and is never finer than what the vehicle states. A frame
/// that shows nothing has no position, whatever was known before.
#[test]
fn each_packet_says_within_how_much_its_position_is_known() {
    let (engine, scene) = on_device(&wall(3));
    let options = EncoderOptions { rate: None, ..EncoderOptions::default() };
    let mut encoder = Encoder::new(&engine, &scene, &CAMERA, options).unwrap();
    let mut decoder = Decoder::new(&engine, &scene);
    let (clear, grey) = (frame(&engine, &scene, &pose(0.0)), silt(110.0, 1));
    for (picture, is_known) in [(&clear, true), (&grey, false), (&clear, true)] {
        let Encoded { stats, packet, .. } = encoder.encode(picture, Some(pose(0.0))).unwrap();
        let decoded = decoder.decode(&packet).unwrap();
        assert_eq!((stats.known.is_some(), decoded.known), (is_known, stats.known));
        assert_eq!((stats.certain, decoded.uncertain), (is_known, !is_known));
        let deviation = stats.pose_deviation();
        let Some(known) = decoded.known else {
            assert_eq!(deviation, [f64::INFINITY; 6]);
            continue;
        };
        assert!(deviation.iter().take(3).all(|d| *d > 0.0 && *d <= known.position));
        assert!(deviation.iter().skip(3).all(|d| *d > 0.0 && *d <= known.rotation));
        // It is a covariance, as hints state one.
        assert!(Hint::with_covariance(pose(0.0), &stats.covariance).is_some());
    }
}

/// After silt or darkness, however long, the first clear frame is found again from the place at which the track was
/// lost.
#[test]
fn clear_water_is_found_again_at_once() {
    let (engine, scene) = on_device(&wall(3));
    for (value, length) in [(110.0, 1), (110.0, 4), (0.0, 15)] {
        let options = EncoderOptions { rate: None, ..EncoderOptions::default() };
        let mut encoder = Encoder::new(&engine, &scene, &CAMERA, options).unwrap();
        let mut encode = |picture: &Picture, start| encoder.encode(picture, start).unwrap().stats;
        for t in 0..3 {
            let clear = frame(&engine, &scene, &pose(t.into()));
            assert!(encode(&clear, (t == 0).then(|| pose(0.0))).certain);
        }
        for seed in 0..length {
            assert!(!encode(&silt(value, seed), None).certain);
        }
        let clear = frame(&engine, &scene, &pose(3.0));
        let stats = encode(&clear, None);
        let best = render(&engine, &scene, &pose(3.0)).psnr(&clear);
        assert!(stats.certain && stats.render_psnr > best - 0.1, "{value} × {length}: {stats:?}");
    }
    assert_silent(&engine);
}

/// The prior at a pose.
fn render(engine: &Engine, scene: &Arc<Scene>, pose: &Pose) -> Picture {
    let mut renderer = engine.renderer(scene, &CAMERA, Plan::picture()).unwrap();
    let mut render = Picture::new(CAMERA.width, CAMERA.height);
    renderer.picture(pose, &mut render).unwrap();
    render
}

/// A sudden change of the light, by gain, offset and cast, does not lose the track and leads to no other pose.
#[test]
fn light_may_change_at_once() {
    let (engine, scene) = on_device(&wall(3));
    for (gain, offset) in [
        ([0.3; 3], [0.0; 3]),
        ([0.25; 3], [0.0; 3]),
        ([0.2; 3], [0.3; 3]),
        ([0.5, 1.0, 0.8], [0.0, 0.1, 0.1]),
    ] {
        let options = EncoderOptions { rate: None, ..EncoderOptions::default() };
        let encoder = || Encoder::new(&engine, &scene, &CAMERA, options.clone()).unwrap();
        let (mut plain, mut changing) = (encoder(), encoder());
        for t in 0..5 {
            let mut picture = frame(&engine, &scene, &pose(t.into()));
            let start = (t == 0).then(|| pose(0.0));
            let expected = plain.encode(&picture, start).unwrap().pose;
            if t >= 2 {
                for (i, byte) in picture.data.iter_mut().enumerate() {
                    let value = f64::from(*byte) * gain[i % 3] + 255.0 * offset[i % 3];
                    *byte = value.round().clamp(0.0, 255.0) as u8;
                }
            }
            let encoded = changing.encode(&picture, start).unwrap();
            assert!(encoded.stats.certain, "{gain:?} {offset:?} {t}");
            let off = pose_error(&encoded.pose, &expected);
            assert!(off < 0.5, "{gain:?} {offset:?} {t}: {off} pixels");
        }
    }
}

#[test]
fn a_budget_holds_for_the_whole_packet() {
    let (engine, scene) = on_device(&wall(5));
    let picture = frame(&engine, &scene, &pose(0.0));
    for budget in [49, 64, 256, 600, 1024] {
        let rate = Some(Rate::Bytes(budget));
        let options = EncoderOptions { rate, ..EncoderOptions::default() };
        let mut encoder = Encoder::new(&engine, &scene, &CAMERA, options).unwrap();
        let encoded = encoder.encode(&picture, Some(pose(0.0))).unwrap();
        assert!(encoded.packet.len() <= budget, "{} for {budget}", encoded.packet.len());
        assert_eq!(encoded.stats.rate_kept, encoded.packet.len() > 49, "at {budget}");
        let decoded = Decoder::new(&engine, &scene).decode(&encoded.packet).unwrap();
        assert_eq!(decoded.picture, encoded.picture);
    }
    let options = EncoderOptions { rate: Some(Rate::Bytes(20)), ..EncoderOptions::default() };
    let mut encoder = Encoder::new(&engine, &scene, &CAMERA, options).unwrap();
    assert!(matches!(
        encoder.encode(&picture, Some(pose(0.0))),
        Err(Error::Budget { budget: 20, needed: 49 })
    ));
}

#[test]
fn encoding_twice_gives_the_same_bytes() {
    let (engine, scene) = on_device(&wall(6));
    let picture = frame(&engine, &scene, &pose(0.5));
    let encode = || {
        let mut encoder =
            Encoder::new(&engine, &scene, &CAMERA, EncoderOptions::default()).unwrap();
        encoder.encode(&picture, Some(pose(0.0))).unwrap().packet
    };
    assert_eq!(encode(), encode());
}

#[test]
fn a_decoder_refuses_what_it_cannot_show_and_shows_what_it_can() {
    let (engine, scene) = on_device(&wall(7));
    let mut encoder = Encoder::new(&engine, &scene, &CAMERA, EncoderOptions::default()).unwrap();
    let encode = |encoder: &mut Encoder, t: f64| {
        let picture = frame(&engine, &scene, &pose(t));
        encoder.encode(&picture, Some(pose(t))).unwrap()
    };
    let first = encode(&mut encoder, 0.0);
    let second = encode(&mut encoder, 1.0);

    let other = engine.upload(&wall(8)).unwrap();
    let refused = Decoder::new(&engine, &other).decode(&first.packet);
    assert!(matches!(refused, Err(Error::Packet(_))), "another prior");

    // The second packet only names its camera: after a loss, the topside must be told about the camera.
    let mut decoder = Decoder::new(&engine, &scene);
    let lost = decoder.decode(&second.packet);
    assert!(matches!(lost, Err(Error::SessionUnknown { frame: 1, cameras: 0, .. })));
    decoder.add_camera(&CAMERA).unwrap();
    assert_eq!(decoder.decode(&second.packet).unwrap().picture, second.picture);

    // So does a topside that holds another prior.
    let mut elsewhere = Decoder::new(&engine, &other);
    elsewhere.add_camera(&CAMERA).unwrap();
    let refused = elsewhere.decode(&second.packet);
    assert!(matches!(refused, Err(Error::SessionUnknown { cameras: 1, .. })), "{refused:?}");

    // The latent part alone makes a picture; a damaged residual leaves it.
    let alone = decoder.decode(&second.packet[..20]).unwrap();
    assert_eq!(alone.picture, second.render);
    assert!(alone.damage.is_some());
    let mut damaged = second.packet.clone();
    *damaged.last_mut().unwrap() ^= 1;
    let decoded = decoder.decode(&damaged).unwrap();
    assert_eq!(decoded.picture, second.render);
    assert!(decoded.damage.is_some());
    damaged[5] ^= 1;
    assert!(decoder.decode(&damaged).is_err());
}

/// A topside that has drawn packets of its own prior meets those of 100,000 others. Some have its own tag by chance.
#[test]
fn packets_of_other_priors_are_refused() {
    let (engine, scene) = on_device(&wall(7));
    let mut encoder = Encoder::new(&engine, &scene, &CAMERA, EncoderOptions::default()).unwrap();
    let picture = frame(&engine, &scene, &pose(0.0));
    let own = encoder.encode(&picture, Some(pose(0.0))).unwrap();
    let mut decoder = Decoder::new(&engine, &scene);
    let tag = Packet::decode(&own.packet).unwrap().latent.tag;
    let mut random = Random::new(53);
    let mut same_tag = 0;
    for _ in 0..100_000 {
        let prior = PriorId(random.bits() as u32);
        if prior == scene.id() {
            continue;
        }
        let session = Session { prior, camera: CAMERA };
        let packet = |frame, session: Option<Session>| {
            let whose = Session { prior, camera: CAMERA };
            let quantise =
                |profile| QuantisedPose::quantise(&pose(0.0), &scene.coordinate_frame(), profile);
            let profile = if session.is_some() { PoseProfile::Compact } else { PoseProfile::Short };
            let latent = Latent::new(frame, &whose, quantise(profile).unwrap(), false).unwrap();
            let residual = Residual::None;
            Packet { latent, session, render: None, residual, truth: None }.encode().unwrap()
        };
        if session.tag() == Ok(tag) {
            same_tag += 1;
            // The worst case: the topside has just drawn its own.
            assert_eq!(decoder.decode(&own.packet).unwrap().picture, own.picture);
        }
        let refused = decoder.decode(&packet(1, Some(session)));
        assert!(matches!(refused, Err(Error::Packet(PacketError::Prior { .. }))), "{refused:?}");
        let refused = decoder.decode(&packet(2, None));
        assert!(matches!(refused, Err(Error::Estranged { frame: 2 })), "{refused:?}");
    }
    // One in 65,536.
    assert!((1..10).contains(&same_tag), "{same_tag}");
    let next = encoder.encode(&picture, None).unwrap();
    assert!(matches!(decoder.decode(&next.packet), Err(Error::Estranged { .. })));
    assert_eq!(decoder.decode(&own.packet).unwrap().picture, own.picture);
    assert_eq!(decoder.decode(&next.packet).unwrap().picture, next.picture);
}

/// Packets state the session, prior and camera, if the topside may not know it.
#[test]
fn a_session_is_stated_when_it_may_not_be_known() {
    let (engine, scene) = on_device(&wall(7));
    let pictures: Vec<_> = (0..3).map(|t| frame(&engine, &scene, &pose(t.into()))).collect();
    let options = || EncoderOptions { rate: None, first_frame: 0xFFFD, ..Default::default() };
    let start = Some(pose(0.0));

    let every_third = EncoderOptions { camera_interval: 3, ..options() };
    let mut encoder = Encoder::new(&engine, &scene, &CAMERA, every_third).unwrap();
    let mut decoder = Decoder::new(&engine, &scene);
    let mut next = |encoder: &mut Encoder, t: usize| {
        let encoded = encoder.encode(&pictures[t % 3], start).unwrap();
        let decoded = decoder.decode(&encoded.packet).unwrap();
        assert_eq!(decoded.picture, encoded.picture);
        assert_eq!(decoded.frame, 0xFFFD + t as u32, "the count goes on beyond sixteen bits");
        assert_eq!(
            Latent::decode(&encoded.packet).unwrap().encoded_len(),
            encoded.stats.latent_bytes
        );
        encoded.packet.len()
    };
    let lengths: Vec<_> = (0..5).map(|t| next(&mut encoder, t)).collect();
    assert_eq!(lengths, [49, 20, 20, 49, 20]);
    encoder.reset();
    assert_eq!([next(&mut encoder, 5), next(&mut encoder, 6)], [49, 20]);
    encoder.announce();
    assert_eq!([next(&mut encoder, 7), next(&mut encoder, 8)], [49, 20]);
    let longer = Camera { fx: CAMERA.fx * 1.01, ..CAMERA };
    encoder.set_camera(&longer).unwrap();
    assert_eq!([next(&mut encoder, 9), next(&mut encoder, 10)], [49, 20]);
}

#[test]
fn a_budget_holds_for_a_short_packet() {
    let (engine, scene) = on_device(&wall(5));
    let picture = frame(&engine, &scene, &pose(0.0));
    let mut encoder = Encoder::new(&engine, &scene, &CAMERA, EncoderOptions::default()).unwrap();
    encoder.encode(&picture, Some(pose(0.0))).unwrap();
    let mut decoder = Decoder::new(&engine, &scene);
    decoder.add_camera(&CAMERA).unwrap();
    for budget in [20, 30, 250, 400, 800] {
        encoder.set_rate(Some(Rate::Bytes(budget)));
        let encoded = encoder.encode(&picture, None).unwrap();
        assert_eq!(encoded.stats.latent_bytes, 20);
        assert!(encoded.packet.len() <= budget, "{} for {budget}", encoded.packet.len());
        assert_eq!(decoder.decode(&encoded.packet).unwrap().picture, encoded.picture);
    }
    encoder.set_rate(Some(Rate::Bytes(19)));
    let refused = encoder.encode(&picture, None);
    assert!(matches!(refused, Err(Error::Budget { budget: 19, needed: 20 })));
}

#[test]
fn a_coder_goes_on_elsewhere_where_it_was() {
    let (engine, scene) = on_device(&wall(9));
    let frames: Vec<_> = (0..3).map(|t| frame(&engine, &scene, &pose(t.into()))).collect();
    let options = EncoderOptions { first_frame: 40, threshold: 1.0, ..EncoderOptions::default() };
    let mut stayed = Encoder::new(&engine, &scene, &CAMERA, options.clone()).unwrap();
    let mut moved = Encoder::new(&engine, &scene, &CAMERA, options).unwrap();
    let mut decoder = Decoder::new(&engine, &scene);
    for (frame, hint) in frames.iter().zip([Some(pose(0.0)), None]) {
        stayed.encode(frame, hint).unwrap();
        decoder.decode(&moved.encode(frame, hint).unwrap().packet).unwrap();
    }
    let elsewhere = nvsprior::Engine::new(&Default::default()).unwrap();
    let other = elsewhere.upload(&wall(10)).unwrap();
    assert!(matches!(moved.move_to(&elsewhere, &other), Err(Error::PriorChanged { .. })));
    let same = elsewhere.upload(&wall(9)).unwrap();
    moved.move_to(&elsewhere, &same).unwrap();
    decoder.move_to(&elsewhere, &same).unwrap();
    let (expected, found) = (stayed.encode(&frames[2], None), moved.encode(&frames[2], None));
    let found = found.unwrap();
    assert_eq!(found.packet, expected.unwrap().packet, "frame number, poses and camera went along");
    assert_eq!(decoder.decode(&found.packet).unwrap().picture, found.picture);
    assert_eq!(found.stats.frame, 42);
}

#[test]
fn the_rate_may_change_with_the_link() {
    let (engine, scene) = on_device(&wall(11));
    let picture = frame(&engine, &scene, &pose(0.0));
    let options = EncoderOptions { rate: Some(Rate::Quality(98.0)), ..EncoderOptions::default() };
    let mut encoder = Encoder::new(&engine, &scene, &CAMERA, options).unwrap();
    let fine = encoder.encode(&picture, Some(pose(0.0))).unwrap();
    encoder.set_rate(Some(Rate::Bytes(300)));
    let coarse = encoder.encode(&picture, None).unwrap();
    encoder.set_rate(None);
    let bare = encoder.encode(&picture, None).unwrap();
    let [fine, coarse, bare] = [fine, coarse, bare].map(|encoded| encoded.packet.len());
    assert!(fine > 300 && coarse <= 300 && coarse > 20 && bare == 20, "{fine}, {coarse}, {bare}");
}

/// Packets that state the session have a check, until the topside has acknowledged a frame.
#[test]
fn render_checks_end_once_a_frame_is_acknowledged() {
    let engine = common::engine();
    let scene = engine.upload(&scene::wall(1)).unwrap();
    let options = EncoderOptions {
        render_checks: RenderChecks::AsNeeded,
        camera_interval: 2,
        ..EncoderOptions::default()
    };
    let pose = scene::pose(0.0);
    let frame = scene::frame(&engine, &scene, &pose);
    let mut encoder = Encoder::new(&engine, &scene, &scene::CAMERA, options).unwrap();
    let mut has = Vec::new();
    for t in 0..9 {
        let encoded = encoder.encode(&frame, Some(pose)).unwrap();
        let packet = Packet::decode(&encoded.packet).unwrap();
        has.push((packet.session.is_some(), packet.render.is_some()));
        match t {
            // The topside does not hold the pose, which confirms nothing.
            0 => encoder.acknowledge_pose(0, false),
            3 => encoder.acknowledge(2),
            5 => encoder.reset(),
            6 => encoder.acknowledge_pose(6, true),
            _ => {}
        }
    }
    let (both, session, none) = ((true, true), (true, false), (false, false));
    let checked = if engine.device().portable { session } else { both };
    assert_eq!(has, [both, none, both, none, checked, none, both, none, checked]);
    common::assert_silent(&engine);
}

/// If the vehicle sends a check, a topside whose prior looks a little different learns of it.
#[test]
fn a_render_check_tells_a_different_render() {
    let engine = common::engine();
    let scene = engine.upload(&scene::wall(1)).unwrap();
    let options =
        EncoderOptions { render_checks: RenderChecks::Every(2), ..EncoderOptions::default() };
    let mut encoder = Encoder::new(&engine, &scene, &scene::CAMERA, options).unwrap();
    let [mut decoder, mut elsewhere] = [(), ()].map(|()| Decoder::new(&engine, &scene));
    for t in 0..3_u32 {
        let pose = scene::pose(f64::from(t));
        let frame = scene::frame(&engine, &scene, &pose);
        let encoded = encoder.encode(&frame, Some(pose)).unwrap();
        let decoded = decoder.decode(&encoded.packet).unwrap();
        assert_eq!(decoded.same_render, (t % 2 == 0).then_some(true), "frame {t}");
        let packet = Packet::decode(&encoded.packet).unwrap();
        if let (0, Some(check)) = (t, packet.render) {
            let render = Some(RenderCheck(check.0 ^ 1));
            let other = Packet { render, ..packet }.encode().unwrap();
            let decoded = elsewhere.decode(&other).unwrap();
            assert_eq!(decoded.same_render, Some(false));
            assert_eq!(decoded.picture, encoded.picture, "shown all the same");
        } else {
            // Another render was drawn there, so what does not state the session is not shown.
            let refused = elsewhere.decode(&encoded.packet);
            assert!(matches!(refused, Err(Error::Estranged { frame }) if frame == t));
        }
        if t == 2 {
            encoder.announce();
            let encoded = encoder.encode(&frame, Some(pose)).unwrap();
            assert_eq!(elsewhere.decode(&encoded.packet).unwrap().picture, encoded.picture);
        }
    }
    common::assert_silent(&engine);
}
