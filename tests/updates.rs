//! Updates of a prior between a vehicle and a topside: which packets need them, what is shown without them.

mod common;
mod scene;

use std::sync::Arc;

use common::{Random, assert_silent, engine};
use nvsprior::packet::Latent;
use nvsprior::prior::{Learnt, UpdateError};
use nvsprior::render::Scene;
use nvsprior::{
    Decoded, Decoder, Encoder, EncoderOptions, Engine, Error, Picture, Prior, Rate, Trust,
};
use scene::{CAMERA, chain, clean_frame, on_device, pose, update, wall};

fn for_updates(engine: &Engine, prior: &Prior) -> Arc<Scene> {
    engine.upload_for_updates(prior).unwrap()
}

fn options() -> EncoderOptions {
    EncoderOptions { rate: Some(Rate::Quality(30.0)), ..EncoderOptions::default() }
}

/// A dive in which an update comes before each of some frames: packets, and the pictures that the vehicle expects.
struct Dive {
    packets: Vec<Vec<u8>>,
    pictures: Vec<Picture>,
    renders: Vec<Picture>,
    /// Updates that each frame is drawn with.
    updates: Vec<usize>,
}

impl Dive {
    fn new(prior: &Prior, chain: &[(Vec<u8>, Learnt)], frames: usize, before: &[usize]) -> Dive {
        let (engine, plain) = on_device(prior);
        let mut encoder =
            Encoder::new(&engine, &for_updates(&engine, prior), &CAMERA, options()).unwrap();
        let (packets, pictures, renders) = (Vec::new(), Vec::new(), Vec::new());
        let mut dive = Dive { packets, pictures, renders, updates: Vec::new() };
        let mut updates = 0;
        for t in 0..frames {
            if before.contains(&t) {
                encoder.set_learnt(&chain[updates].1).unwrap();
                updates += 1;
            }
            let truth = pose(t as f64);
            let frame = clean_frame(&engine, &plain, &truth);
            let encoded = encoder.encode(&frame, (t == 0).then_some(truth)).unwrap();
            dive.packets.push(encoded.packet);
            dive.pictures.push(encoded.picture);
            dive.renders.push(encoded.render);
            dive.updates.push(updates);
        }
        assert_silent(&engine);
        dive
    }
}

#[test]
fn both_sides_draw_the_same_with_the_same_updates() {
    let prior = wall(31);
    let chain = chain(&prior, 2);
    let dive = Dive::new(&prior, &chain, 6, &[2, 4]);
    let engine = engine();
    let mut decoder = Decoder::new(&engine, &for_updates(&engine, &prior));
    let mut sent = 0;
    for (t, packet) in dive.packets.iter().enumerate() {
        let latent = Latent::decode(packet).unwrap();
        assert_eq!(latent.update, (dive.updates[t] > 0).then_some(dive.updates[t] as u8));
        // The first frame, and the first one of each state, name it in full.
        assert_eq!(latent.is_short(), ![0, 2, 4].contains(&t), "frame {t}");
        assert_eq!(latent.encoded_len(), [31, 19, 31, 20, 31, 20][t]);
        if dive.updates[t] > sent {
            assert_eq!(decoder.add_update(&chain[sent].0).unwrap(), sent as u16 + 1);
            sent += 1;
        }
        let decoded = decoder.decode(packet).unwrap();
        assert_eq!(decoded.picture, dive.pictures[t], "frame {t}");
        assert_eq!((decoded.missing_update, decoded.frame), (None, t as u32));
        assert!(decoded.damage.is_none());
    }
    assert_ne!(dive.renders[1], dive.renders[2], "updates show");
    // Late packets of states before are still decoded.
    for t in [3, 0, 5, 1, 4, 2] {
        assert_eq!(decoder.decode(&dive.packets[t]).unwrap().picture, dive.pictures[t], "{t}");
    }
    assert_silent(&engine);
}

#[test]
fn the_picture_of_a_missing_update_is_told_and_has_no_difference_in_it() {
    let prior = wall(32);
    let chain = chain(&prior, 2);
    let dive = Dive::new(&prior, &chain, 4, &[1, 3]);
    let engine = engine();
    let scene = for_updates(&engine, &prior);
    let mut decoder = Decoder::new(&engine, &scene);
    // Nothing was decoded yet: there is no camera to draw with.
    let error = decoder.decode(&dive.packets[2]).unwrap_err();
    assert!(matches!(error, Error::UpdateMissing { update: 1 }), "{error}");
    decoder.decode(&dive.packets[0]).unwrap();
    for t in [1, 2] {
        let decoded = decoder.decode(&dive.packets[t]).unwrap();
        assert_eq!(decoded.missing_update, Some(1));
        assert!(matches!(decoded.damage, Some(Error::UpdateMissing { update: 1 })));
        assert_eq!((decoded.rows, decoded.kept), (0, false));
        let latent = Latent::decode(&dive.packets[t]).unwrap();
        let mut plain = Picture::new(CAMERA.width, CAMERA.height);
        let plan = nvsprior::render::Plan::picture();
        let mut renderer = engine.renderer(&on_device(&prior).1, &CAMERA, plan).unwrap();
        renderer.coded_picture(&latent.pose.words(), &mut plain).unwrap();
        assert_eq!(decoded.picture, plain, "the prior alone");
    }
    // The second update without the first: refused, and nothing changes.
    let error = decoder.add_update(&chain[1].0).unwrap_err();
    assert!(matches!(error, Error::Update(UpdateError::NotNext { .. })), "{error}");
    decoder.add_update(&chain[0].0).unwrap();
    assert_eq!(decoder.decode(&dive.packets[2]).unwrap().picture, dive.pictures[2]);
    assert_eq!(decoder.decode(&dive.packets[3]).unwrap().missing_update, Some(2));
    decoder.add_update(&chain[1].0).unwrap();
    assert_eq!(decoder.decode(&dive.packets[3]).unwrap().picture, dive.pictures[3]);
    assert_silent(&engine);
}

#[test]
fn another_chain_of_the_same_numbers_is_told_too() {
    let prior = wall(33);
    let own = chain(&prior, 1);
    let dive = Dive::new(&prior, &own, 2, &[1]);
    let mut other = update(&Learnt::none(prior.id()));
    other.splats[0].colour[0] += 1;
    let mut bytes = Vec::new();
    other.write(&mut bytes).unwrap();
    let engine = engine();
    let mut decoder = Decoder::new(&engine, &for_updates(&engine, &prior));
    decoder.add_update(&bytes).unwrap();
    decoder.decode(&dive.packets[0]).unwrap();
    assert_eq!(decoder.decode(&dive.packets[1]).unwrap().missing_update, Some(1));
}

#[test]
fn a_scene_without_room_and_a_foreign_prior_are_refused() {
    let prior = wall(34);
    let (engine, scene) = on_device(&prior);
    let chain = chain(&prior, 1);
    let mut decoder = Decoder::new(&engine, &scene);
    let no_room = |error: &Error| matches!(error, Error::Update(UpdateError::NoRoom));
    assert!(no_room(&decoder.add_update(&chain[0].0).unwrap_err()));
    let mut encoder = Encoder::new(&engine, &scene, &CAMERA, options()).unwrap();
    assert!(no_room(&encoder.set_learnt(&chain[0].1).unwrap_err()));
    let other = wall(35);
    let mut decoder = Decoder::new(&engine, &for_updates(&engine, &other));
    let error = decoder.add_update(&chain[0].0).unwrap_err();
    assert!(matches!(error, Error::Update(UpdateError::Foreign { .. })), "{error}");
    assert!(decoder.set_learnt(&chain[0].1).is_err());
    let mut damaged = chain[0].0.clone();
    damaged[20] ^= 1;
    let mut decoder = Decoder::new(&engine, &for_updates(&engine, &prior));
    assert!(decoder.add_update(&damaged).is_err());
    assert_eq!(decoder.learnt().number(), 0);
}

/// Packets and updates are lost, come twice and late; topsides restart and join in the middle, with what they had
/// written down or without it. What is shown as whole is what the vehicle expects, always.
#[test]
fn no_wrong_picture_is_shown_as_right() {
    const FRAMES: usize = 24;
    let prior = wall(36);
    let chain = chain(&prior, 10);
    let before: Vec<usize> = (1..=10).map(|update| 2 * update).collect();
    let dive = Dive::new(&prior, &chain, FRAMES, &before);
    let engine = engine();
    let scene = for_updates(&engine, &prior);
    let mut random = Random::new(36);
    let mut chance = |share: f32| random.within(0.0, 1.0) < share;
    let (mut whole, mut missing) = (0, 0);
    let mut decoder = Decoder::new(&engine, &scene);
    let mut decoded = Decoded::default();
    for _ in 0..25 {
        let mut held = 0;
        for (t, packet) in dive.packets.iter().enumerate() {
            if chance(0.04) {
                let kept = if chance(0.5) { held } else { 0 };
                decoder = Decoder::new(&engine, &scene);
                held = 0;
                for (update, _) in &chain[..kept] {
                    decoder.add_update(update).unwrap();
                    held += 1;
                }
            }
            // Updates are asked for again until they come.
            while held < dive.updates[t] && chance(0.6) {
                decoder.add_update(&chain[held].0).unwrap();
                held += 1;
            }
            let late = if chance(0.2) { t.saturating_sub(3) } else { t };
            if chance(0.2) {
                continue;
            }
            let packet = if late < t { &dive.packets[late] } else { packet };
            if decoder.decode_into(packet, Trust::Whole, &mut decoded).is_err() {
                continue;
            }
            missing += usize::from(decoded.missing_update.is_some());
            if decoded.missing_update.is_none() && decoded.damage.is_none() {
                assert_eq!(decoded.picture, dive.pictures[late], "frame {late} at {t}");
                whole += 1;
            }
        }
        decoder = Decoder::new(&engine, &scene);
    }
    assert!(whole > 200 && missing > 50, "{whole} whole, {missing} missing");
    assert_silent(&engine);
}

#[test]
fn without_a_frame_before_the_camera_that_is_known_shows_what_is_held() {
    let prior = wall(37);
    let chain = chain(&prior, 1);
    let dive = Dive::new(&prior, &chain, 4, &[1]);
    let engine = engine();
    let mut decoder = Decoder::new(&engine, &for_updates(&engine, &prior));
    decoder.add_camera(&CAMERA).unwrap();
    for t in [1, 2] {
        let parsed = nvsprior::packet::Parsed::of(&dive.packets[t]).unwrap();
        let size = (t == 1).then_some((CAMERA.width, CAMERA.height));
        assert_eq!(decoder.size_to_prepare(&parsed), size, "room is made with the first frame");
        let decoded = decoder.decode(&dive.packets[t]).unwrap();
        assert_eq!((decoded.missing_update, decoded.rows), (Some(1), 0));
    }
    decoder.add_update(&chain[0].0).unwrap();
    assert_eq!(decoder.decode(&dive.packets[2]).unwrap().picture, dive.pictures[2]);
    assert_silent(&engine);
}

#[test]
fn a_chain_that_begins_anew_is_taken_and_what_came_after_is_forgotten() {
    let prior = wall(38);
    let chain = chain(&prior, 12);
    let engine = engine();
    let mut decoder = Decoder::new(&engine, &for_updates(&engine, &prior));
    for (k, (update, _)) in chain.iter().enumerate() {
        assert_eq!(decoder.add_update(update).unwrap(), k as u16 + 1);
        // Any that is there already changes nothing.
        assert_eq!(decoder.add_update(&chain[k / 2].0).unwrap(), k as u16 + 1);
    }
    let numbers = |decoder: &Decoder| decoder.states().map(|(n, _)| n).collect::<Vec<_>>();
    assert_eq!(numbers(&decoder), [12, 11, 10, 9, 8, 7, 6, 5]);
    let after = |learnt: &Learnt| {
        let mut other = update(learnt);
        other.splats[0].colour[0] += 1;
        let mut bytes = Vec::new();
        other.write(&mut bytes).unwrap();
        bytes
    };
    // On a state that is held: those after it go.
    assert_eq!(decoder.add_update(&after(&chain[5].1)).unwrap(), 7);
    assert_eq!(numbers(&decoder), [7, 6, 5]);
    // On one that is not held any more: all go, and come again.
    let third = after(&chain[1].1);
    assert!(decoder.add_update(&third).is_err());
    assert_eq!((numbers(&decoder), decoder.learnt().number()), (vec![], 0));
    for (update, _) in &chain[..2] {
        decoder.add_update(update).unwrap();
    }
    assert_eq!(decoder.add_update(&third).unwrap(), 3);
    // On the prior itself.
    assert_eq!(decoder.add_update(&after(&Learnt::none(prior.id()))).unwrap(), 1);
    assert_eq!(numbers(&decoder), [1]);
}
