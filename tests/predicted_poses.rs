//! Poses that are predicted from those that the topside holds: the same pictures, whatever is lost or begins anew.

mod common;
mod scene;

use std::sync::{Arc, OnceLock};

use common::{assert_silent, engine};
use nvsprior::packet::{PacketError, Part};
use nvsprior::render::Scene;
use nvsprior::{Decoder, Encoded, Encoder, EncoderOptions, Error, Picture, Rate};
use scene::{CAMERA, frame, pose, wall};

const FRAMES: usize = 40;
/// Frames until the vehicle knows what came.
const DELAY: usize = 3;

fn uploaded() -> Arc<Scene> {
    static SCENE: OnceLock<Arc<Scene>> = OnceLock::new();
    SCENE.get_or_init(|| engine().upload(&wall(1)).unwrap()).clone()
}

/// Frames of a slow dive, forth and back.
fn frames() -> &'static [Picture] {
    static PICTURES: OnceLock<Vec<Picture>> = OnceLock::new();
    PICTURES.get_or_init(|| {
        let time = |t: usize| if t < 20 { t } else { 39 - t } as f64;
        (0..FRAMES).map(|t| frame(&engine(), &uploaded(), &pose(0.05 * time(t)))).collect()
    })
}

fn new_encoder(predict_poses: bool) -> Encoder {
    let rate = Some(Rate::Quality(40.0));
    let options = EncoderOptions { predict_poses, rate, ..EncoderOptions::default() };
    Encoder::new(&engine(), &uploaded(), &CAMERA, options).unwrap()
}

fn new_decoder() -> Decoder {
    Decoder::new(&engine(), &uploaded())
}

fn encode(encoder: &mut Encoder, t: usize) -> Encoded {
    encoder.encode(&frames()[t], (t == 0).then(|| pose(0.0))).unwrap()
}

fn is_predicted(encoded: &Encoded) -> bool {
    encoded.packet[0] & 0x1F == 0b1_1001
}

/// Tells the vehicle what the topside holds of the frames before and at `newest`.
fn report(encoder: &mut Encoder, topside: &Decoder, newest: usize) {
    for frame in (newest.saturating_sub(31)..=newest).map(|frame| frame as u32) {
        encoder.acknowledge_pose(frame, topside.holds_pose(frame));
    }
}

#[test]
fn pictures_are_those_of_stated_poses() {
    let (mut encoder, mut plain) = (new_encoder(true), new_encoder(false));
    let mut topside = new_decoder();
    let (mut bytes, mut predicted) = (0, 0);
    for t in 0..FRAMES {
        let (encoded, short) = (encode(&mut encoder, t), encode(&mut plain, t));
        assert_eq!((encoded.pose, &encoded.picture), (short.pose, &short.picture), "frame {t}");
        let decoded = topside.decode(&encoded.packet).unwrap();
        assert_eq!((decoded.frame, decoded.pose), (t as u32, short.pose));
        assert_eq!(decoded.picture, short.picture, "frame {t}");
        assert!(decoded.damage.is_none() && !decoded.uncertain);
        if is_predicted(&encoded) {
            assert!(encoded.packet.len() < short.packet.len());
            bytes += encoded.stats.latent_bytes;
            predicted += 1;
        } else {
            assert_eq!(encoded.packet, short.packet, "frame {t}");
        }
        if t >= DELAY {
            report(&mut encoder, &topside, t - DELAY);
        }
    }
    assert!(predicted >= FRAMES - DELAY - 6, "{predicted}");
    assert!(bytes < 14 * predicted, "{bytes} {predicted}");
    assert_silent(&engine());
}

#[test]
fn whatever_is_lost_what_comes_is_decoded() {
    for lost in [3, 2] {
        let (mut encoder, mut topside) = (new_encoder(true), new_decoder());
        let mut predicted = 0;
        for t in 0..FRAMES {
            let encoded = encode(&mut encoder, t);
            if t == 0 || t * t % 7 % lost != 1 {
                let decoded = topside.decode(&encoded.packet).unwrap();
                assert_eq!(decoded.picture, encoded.picture, "frame {t}");
                predicted += u32::from(is_predicted(&encoded));
            }
            // A report is lost now and then, too.
            if t >= DELAY && t % 4 != 0 {
                report(&mut encoder, &topside, t - DELAY);
            }
        }
        assert!(predicted > 8, "{predicted}");
    }
}

#[test]
fn packets_may_come_late_and_twice() {
    let (mut encoder, mut topside) = (new_encoder(true), new_decoder());
    let mut packets = Vec::new();
    for t in 0..FRAMES {
        packets.push(encode(&mut encoder, t));
        // Poses are held as packets come, in any order; pictures are drawn later.
        let comes = if t % 2 == 0 { [t, t.saturating_sub(1)] } else { [t - 1, t - 1] };
        for place in comes {
            topside.hold(&packets[place].packet).unwrap();
        }
        if t >= 8 {
            let shown = topside.decode(&packets[t - 8].packet).unwrap();
            assert_eq!(shown.picture, packets[t - 8].picture);
        }
        if t >= DELAY {
            report(&mut encoder, &topside, t - DELAY);
        }
    }
    assert!(packets.iter().filter(|encoded| is_predicted(encoded)).count() > 20);
}

#[test]
fn a_topside_that_begins_anew_says_so_and_is_served() {
    let (mut encoder, mut topside) = (new_encoder(true), new_decoder());
    // It hears all packets, and tells nothing.
    let mut listener = new_decoder();
    let (mut refused, mut unheard) = (0, 0);
    for t in 0..FRAMES {
        let encoded = encode(&mut encoder, t);
        if t == 15 {
            topside = new_decoder();
            topside.add_camera(&CAMERA).unwrap();
            listener.add_camera(&CAMERA).unwrap();
        }
        match topside.decode(&encoded.packet) {
            Ok(decoded) => assert_eq!(decoded.picture, encoded.picture),
            Err(Error::Packet(PacketError::PoseNotHeld { frame, reference })) => {
                assert!(frame as usize == t && (reference as usize) < 15);
                refused += 1;
            }
            Err(other) => panic!("frame {t}: {other}"),
        }
        if t >= 15 {
            let heard = listener.decode(&encoded.packet);
            assert!(is_predicted(&encoded) || heard.is_ok());
            unheard += u32::from(heard.is_err());
        }
        if t >= DELAY {
            report(&mut encoder, &topside, t - DELAY);
        }
    }
    assert!((1..=DELAY + 1).contains(&refused), "{refused}");
    assert!((1..FRAMES as u32 - 16).contains(&unheard), "{unheard}");
}

#[test]
fn a_vehicle_that_begins_anew_is_not_taken_for_the_old_one() {
    let (mut encoder, mut topside) = (new_encoder(true), new_decoder());
    for t in 0..12 {
        topside.decode(&encode(&mut encoder, t).packet).unwrap();
        report(&mut encoder, &topside, t);
    }
    // Its numbers begin anew, its poses are others. A late report tells it of the old one's frames.
    let mut encoder = new_encoder(true);
    let mut refused = 0;
    for t in 0..24 {
        let encoded = encoder.encode(&frames()[t + 8], (t == 0).then(|| pose(0.4))).unwrap();
        if t == 4 {
            (0..4).for_each(|frame| encoder.acknowledge_pose(frame, true));
        }
        // Two of its first packets are lost, so that the topside holds poses of both.
        if t == 2 || t == 3 {
            continue;
        }
        match topside.decode(&encoded.packet) {
            Ok(decoded) => assert_eq!(decoded.picture, encoded.picture, "frame {t}"),
            Err(error) => {
                let is_other = |error: &PacketError| match error {
                    PacketError::PoseNotHeld { .. } => true,
                    error => *error == PacketError::Check(Part::Latent),
                };
                assert!(matches!(&error, Error::Packet(error) if is_other(error)), "{error}");
                // From the first true report on, each pose of the old one costs one packet at most.
                assert!((5..13).contains(&t), "frame {t}");
                refused += 1;
            }
        }
        if t >= 8 {
            report(&mut encoder, &topside, t);
        }
    }
    assert!((1..=6).contains(&refused), "{refused}");
}
