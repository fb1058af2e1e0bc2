//! The display filter, through the public API: what it changes, and what it must leave alone.

mod common;
mod scene;

use std::sync::Arc;

use common::assert_silent;
use nvsprior::filter_weights::{Convolution, DILATIONS, FilterWeights, LAYERS, TAPS};
use nvsprior::random::Random;
use nvsprior::render::filter::definition::filtered;
use nvsprior::{Decoder, Encoded, Encoder, EncoderOptions, Engine, Mode, Prior, Rate, Structure};
use scene::{CAMERA, frame, on_device, pose, wall};

/// Weights that change pictures by a few levels.
fn some_weights() -> FilterWeights {
    let mut random = Random::new(9);
    let layer = |number: usize| {
        let (inputs, outputs) = (Convolution::inputs(number), Convolution::outputs(number));
        let last = number + 1 == LAYERS;
        let shift = if last { 10 } else { 9 };
        let mut within = |most: i64| (random.bits() % (2 * most as u64 + 1)) as i64 - most;
        Convolution {
            weights: (0..inputs * outputs * TAPS).map(|_| within(60) as i8).collect(),
            biases: vec![[if last { 128 << shift } else { 64 << shift }, 40]; outputs],
            shifts: vec![shift; outputs],
        }
    };
    assert_eq!(DILATIONS.len(), LAYERS);
    FilterWeights::new((0..LAYERS).map(layer).collect()).unwrap()
}

fn with_weights(prior: &Prior) -> Prior {
    prior.clone().with_filter_weights(Some(some_weights()))
}

/// Packets of a dive.
fn dive(options: EncoderOptions, frames: u32) -> (Prior, Vec<Encoded>) {
    let prior = wall(3);
    let (engine, scene) = on_device(&prior);
    let mut encoder = Encoder::new(&engine, &scene, &CAMERA, options).unwrap();
    let encoded = (0..frames).map(|t| {
        let truth = pose(t.into());
        encoder.encode(&frame(&engine, &scene, &truth), (t == 0).then_some(truth)).unwrap()
    });
    let encoded = encoded.collect();
    (prior, encoded)
}

fn at(bytes: usize) -> EncoderOptions {
    EncoderOptions { rate: Some(Rate::Bytes(bytes)), ..EncoderOptions::default() }
}

#[test]
fn a_filtered_picture_is_the_definitions() {
    let (prior, encoded) = dive(at(150), 3);
    let filtering = with_weights(&prior);
    assert_eq!(filtering.id(), prior.id());
    let (engine, scene) = on_device(&filtering);
    let mut decoder = Decoder::new(&engine, &scene);
    let mut plain = Decoder::new(&engine, &scene);
    decoder.set_filter(true).unwrap();
    for one in &encoded {
        let decoded = decoder.decode(&one.packet).unwrap();
        let other = plain.decode(&one.packet).unwrap();
        assert!(decoded.filtered && !other.filtered);
        assert_eq!(other.picture, one.picture);
        assert_ne!(decoded.picture, one.picture);
        let mut steps = (0..64).filter(|step| {
            filtered(&some_weights(), *step, &one.render, &one.picture) == decoded.picture
        });
        assert!(steps.next().is_some(), "no step of the quantiser gives this picture");
        // All else is as it was.
        assert_eq!((decoded.rows, &decoded.truth), (other.rows, &other.truth));
        assert_eq!((decoded.pose, decoded.same_render), (other.pose, other.same_render));
    }
    // Off and on again, in the middle of a dive.
    decoder.set_filter(false).unwrap();
    let off = decoder.decode(&encoded[1].packet).unwrap();
    assert!(!off.filtered && off.picture == encoded[1].picture);
    decoder.set_filter(true).unwrap();
    assert!(decoder.decode(&encoded[1].packet).unwrap().filtered);
    assert_silent(&engine);
}

#[test]
fn nothing_is_predicted_from_filtered_pictures() {
    let options =
        EncoderOptions { mode: Mode::Stream(Structure::Chain { key_every: 0 }), ..at(200) };
    let (prior, encoded) = dive(options, 5);
    let (engine, scene) = on_device(&with_weights(&prior));
    let mut decoder = Decoder::new(&engine, &scene);
    for (t, one) in encoded.iter().enumerate() {
        decoder.set_filter(t % 2 == 0).unwrap();
        let decoded = decoder.decode(&one.packet).unwrap();
        assert!(decoded.damage.is_none() && decoded.kept, "frame {t}: {:?}", decoded.damage);
        if t % 2 == 1 {
            assert_eq!(decoded.picture, one.picture, "frame {t}");
        }
    }
}

#[test]
fn a_render_alone_is_not_filtered() {
    let options = EncoderOptions { rate: None, ..EncoderOptions::default() };
    let (prior, encoded) = dive(options, 2);
    let (engine, scene) = on_device(&with_weights(&prior));
    let mut decoder = Decoder::new(&engine, &scene);
    decoder.set_filter(true).unwrap();
    for one in &encoded {
        let decoded = decoder.decode(&one.packet).unwrap();
        assert!(!decoded.filtered);
        assert_eq!(decoded.picture, one.picture);
    }
    // A packet with a residual, then its latent part alone: nothing of the step before is left.
    let (_, with) = dive(at(150), 2);
    assert!(decoder.decode(&with[1].packet).unwrap().filtered);
    let latent = &with[1].packet[..with[1].stats.latent_bytes];
    let alone = decoder.decode(latent).unwrap();
    assert!(!alone.filtered && alone.rows == 0);
}

#[test]
fn it_goes_on_with_another_engine() {
    let (prior, encoded) = dive(at(150), 2);
    let filtering = with_weights(&prior);
    let (engine, scene) = on_device(&filtering);
    let mut decoder = Decoder::new(&engine, &scene);
    decoder.set_filter(true).unwrap();
    let before = decoder.decode(&encoded[0].packet).unwrap();
    let other = Engine::new(&Default::default()).unwrap();
    let moved: Arc<_> = other.upload(&filtering).unwrap();
    decoder.move_to(&other, &moved).unwrap();
    let after = decoder.decode(&encoded[0].packet).unwrap();
    assert!(after.filtered);
    assert_eq!(after.picture, before.picture);
}
