//! The paper's system: frames in, packets of its own out, pictures back.

mod common;
mod scene;

use common::assert_silent;
use nvsprior::tracking::StartKind;
use nvsprior::{Picture, Pose, Rate};
use nvsprior_paper::{
    Decoder, DescentOptions, Encoder, EncoderOptions, Error, HEAD_LEN, Optimizer, SESSION_LEN,
};
use scene::{CAMERA, clean_frame, frame, on_device, pose, pose_error, wall};

const OFFSET: [f64; 6] = [0.05, -0.04, 0.06, 0.02, -0.03, 0.02];

fn by(optimizer: Optimizer) -> EncoderOptions {
    let descent = DescentOptions { optimizer, ..DescentOptions::default() };
    EncoderOptions { descent, rate: None, ..EncoderOptions::default() }
}

#[test]
fn every_optimiser_finds_the_pose_and_none_ends_worse_than_it_began() {
    let (engine, scene) = on_device(&wall(2));
    let truth = pose(0.0);
    let frame = clean_frame(&engine, &scene, &truth);
    let near = truth.stepped(&OFFSET.map(|v| v * 0.3));
    for optimizer in [Optimizer::GaussNewton, Optimizer::Bfgs, Optimizer::Adam, Optimizer::AdamBfgs]
    {
        let mut options = by(optimizer);
        options.descent.adam.epochs = 60;
        let mut encoder = Encoder::new(&engine, &scene, &CAMERA, options).unwrap();
        let encoded = encoder.encode(&frame, Some(near)).unwrap();
        let full = || encoder.trace().iter().filter(|e| e.level == 0);
        let best = full().map(|e| e.mse).fold(f64::INFINITY, f64::min);
        let reached = 10f64.powf(-encoded.stats.render_psnr / 10.0);
        // Eight bits and the rounded pose are between the two.
        assert!(reached < best * 1.05 + 1e-5, "{}: {reached} for {best}", optimizer.name());
        let error = pose_error(&encoded.pose, &truth);
        // The gradient methods stop by their tolerances, Adam here by its epochs.
        let limit = match optimizer {
            Optimizer::GaussNewton => 0.2,
            Optimizer::Bfgs | Optimizer::AdamBfgs => 0.5,
            Optimizer::Adam => 2.0,
        };
        assert!(error < limit, "{}: off by {error} pixels", optimizer.name());
    }
    assert_silent(&engine);
}

#[test]
fn starts_follow_the_paper() {
    let (engine, scene) = on_device(&wall(3));
    let frames: Vec<_> = (0..3).map(|t| frame(&engine, &scene, &pose(t.into()))).collect();
    let run = |threshold, external: Option<Pose>| {
        let options = EncoderOptions { threshold, ..by(Optimizer::Bfgs) };
        let mut encoder = Encoder::new(&engine, &scene, &CAMERA, options).unwrap();
        let starts = [Some(pose(0.0)), external, external];
        let start = |(frame, start)| encoder.encode(frame, start).unwrap().stats.start;
        frames.iter().zip(starts).map(start).collect::<Vec<_>>()
    };
    let kinds = run(1.0, Some(pose(1.0)));
    assert_eq!(kinds, [StartKind::External, StartKind::Previous, StartKind::Predicted]);
    assert_eq!(run(0.0, Some(pose(1.0))), [StartKind::External; 3]);
    assert_eq!(run(0.0, None)[1..], [StartKind::BestOfBad; 2]);
}

#[test]
fn what_the_topside_shows_is_what_the_encoder_foretold() {
    let (engine, scene) = on_device(&wall(1));
    for rate in [None, Some(Rate::Quality(10.0)), Some(Rate::Bytes(400)), Some(Rate::Psnr(36.0))] {
        let options = EncoderOptions { rate, ..by(Optimizer::GaussNewton) };
        let mut encoder = Encoder::new(&engine, &scene, &CAMERA, options).unwrap();
        let mut decoder = Decoder::new(&engine, &scene);
        let mut shown = Picture::default();
        for t in 0..3 {
            let seen = frame(&engine, &scene, &pose(t.into()));
            let encoded = encoder.encode(&seen, (t == 0).then(|| pose(0.0))).unwrap();
            decoder.decode(&encoded.packet, &mut shown).unwrap();
            assert_eq!(shown, encoded.picture, "{rate:?}, frame {t}");
            assert_eq!(encoded.stats.psnr, seen.psnr(&shown));
            assert_eq!(encoded.stats.bytes, encoded.packet.len());
            match rate {
                Some(Rate::Bytes(budget)) => assert!(encoded.packet.len() <= budget),
                Some(Rate::Psnr(psnr)) => assert!(encoded.stats.psnr >= psnr),
                Some(Rate::Quality(_)) => assert!(encoded.packet.len() > HEAD_LEN + SESSION_LEN),
                None => {
                    let session = if t == 0 { SESSION_LEN } else { 0 };
                    assert_eq!(encoded.packet.len(), HEAD_LEN + session);
                }
            }
        }
    }
    assert_silent(&engine);
}

#[test]
fn what_cannot_be_is_refused_and_loses_nothing() {
    let (engine, scene) = on_device(&wall(1));
    let (_, other) = on_device(&wall(2));
    let mut encoder = Encoder::new(&engine, &scene, &CAMERA, by(Optimizer::Bfgs)).unwrap();
    let seen = frame(&engine, &scene, &pose(0.0));
    assert!(matches!(encoder.encode(&seen, None), Err(Error::NoStart { frame: 0 })));
    assert!(encoder.encode(&Picture::new(8, 8), Some(pose(0.0))).is_err());
    let first = encoder.encode(&seen, Some(pose(0.0))).unwrap();
    let second = encoder.encode(&seen, None).unwrap();
    let mut decoder = Decoder::new(&engine, &scene);
    let mut shown = Picture::default();
    assert!(matches!(decoder.decode(&second.packet, &mut shown), Err(Error::SessionUnknown)));
    decoder.decode(&first.packet, &mut shown).unwrap();
    for len in 0..first.packet.len() {
        assert!(decoder.decode(&first.packet[..len], &mut shown).is_err(), "{len} bytes");
        assert_eq!(shown, first.picture);
    }
    let refused = Decoder::new(&engine, &other).decode(&first.packet, &mut shown);
    assert!(matches!(refused, Err(Error::OtherPrior { .. })));
    decoder.decode(&second.packet, &mut shown).unwrap();
    assert_eq!(shown, second.picture);
}
