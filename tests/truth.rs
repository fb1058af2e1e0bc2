//! What the truth map says of a picture, compared with the picture and what the camera saw: at all rates, with packets
//! that are cut, lost or damaged.

mod common;
mod scene;

use nvsprior::packet::Parsed;
use nvsprior::truth::{BLOCK, TruthLevel, TruthMap};
use nvsprior::{Decoded, Decoder, Encoded, Encoder, EncoderOptions, Mode, Picture, Rate};
use nvsprior::{Structure, Trust};
use scene::{CAMERA, frame, on_device, pose, wall};

const FRAMES: usize = 6;

/// RMS of all windows of 16×16 pixels of two pictures, with the block that their centre lies in.
fn windows(seen: &Picture, shown: &Picture) -> Vec<(usize, f64)> {
    let (width, height) = (seen.width as usize, seen.height as usize);
    let block = BLOCK as usize;
    let mut found = Vec::new();
    for top in 0..=height - block {
        for left in 0..=width - block {
            let mut sum = 0.0;
            for y in top..top + block {
                let row = 3 * (y * width + left)..3 * (y * width + left + block);
                let pairs = seen.data[row.clone()].iter().zip(&shown.data[row]);
                sum += pairs.map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2)).sum::<f64>();
            }
            let index =
                (top + block / 2) / block * width.div_ceil(block) + (left + block / 2) / block;
            found.push((index, (sum / (3 * block * block) as f64).sqrt()));
        }
    }
    found
}

/// Fails if a map says less than what is true.
fn check(map: &TruthMap, seen: &Picture, shown: &Picture, what: &str) {
    let [first, second] = map.thresholds.map_or([0.0; 2], |thresholds| thresholds.map(f64::from));
    for (block, rms) in windows(seen, shown) {
        let most = match map.levels[block] {
            0 => first,
            1 => second,
            _ => f64::INFINITY,
        };
        assert!(rms < most + 0.01, "{what}: block {block} is off by {rms}, and {most} is said");
    }
}

/// A dive along a wall with a bright patch that the prior does not know, and more of it in later frames.
fn dive(rate: Rate, mode: Mode) -> (Decoder, Vec<(Picture, Encoded)>) {
    let (engine, scene) = on_device(&wall(1));
    let rate = Some(rate);
    let options = EncoderOptions { rate, mode, truth: true, ..EncoderOptions::default() };
    let mut encoder = Encoder::new(&engine, &scene, &CAMERA, options).unwrap();
    let frames = (0..FRAMES).map(|t| {
        let mut seen = frame(&engine, &scene, &pose(t as f64));
        for row in 50..50 + 5 * t {
            seen.data[3 * (row * 160 + 80)..3 * (row * 160 + 120)].fill(250);
        }
        let encoded = encoder.encode(&seen, pose(t as f64)).unwrap();
        (seen, encoded)
    });
    let frames = frames.collect();
    (Decoder::new(&engine, &scene), frames)
}

const RATES: [Rate; 7] = [
    Rate::Bytes(60),
    Rate::Bytes(90),
    Rate::Bytes(200),
    Rate::Bytes(700),
    Rate::Quality(30.0),
    Rate::Psnr(28.0),
    Rate::Psnr(36.0),
];

#[test]
fn whole_packets_say_what_is_true() {
    for rate in RATES {
        let (mut decoder, frames) = dive(rate, Mode::Intra);
        for (number, (seen, encoded)) in frames.iter().enumerate() {
            let decoded = decoder.decode(&encoded.packet).unwrap();
            let what = format!("{rate:?}, frame {number}");
            assert!(decoded.picture == encoded.picture, "{what}");
            assert!(decoded.truth.thresholds.is_some(), "{what}: a map");
            check(&decoded.truth, seen, &decoded.picture, &what);
            if let Rate::Bytes(budget) = rate {
                assert!(encoded.packet.len() <= budget, "{what}: {}", encoded.packet.len());
            }
            let most = (encoded.packet.len() * 8 / 100).max(6) + 4;
            assert!(encoded.stats.truth_bytes <= most, "{what}: {}", encoded.stats.truth_bytes);
        }
    }
}

#[test]
fn a_change_is_said_even_at_few_bytes() {
    let (mut decoder, frames) = dive(Rate::Bytes(60), Mode::Intra);
    let shown = frames.iter().map(|(_, encoded)| decoder.decode(&encoded.packet).unwrap());
    let decoded = shown.last().unwrap();
    assert!(decoded.truth.count(TruthLevel::Wrong) > 0, "{:?}", decoded.truth);
    // The wall as mapped is not called wrong.
    assert!(decoded.truth.count(TruthLevel::AsSeen) > 10, "{:?}", decoded.truth);
}

#[test]
fn cut_packets_say_what_is_true_or_nothing() {
    let mut told = 0;
    let stream = Mode::Stream(Structure::Chain { key_every: 4 });
    for (rate, mode) in RATES.iter().flat_map(|rate| [(*rate, Mode::Intra), (*rate, stream)]) {
        let (mut decoder, frames) = dive(rate, mode);
        for (number, (seen, encoded)) in frames.iter().enumerate() {
            let packet = &encoded.packet;
            let step = (packet.len() / 12).max(1);
            for len in
                (encoded.stats.latent_bytes..packet.len()).step_by(step).chain([packet.len()])
            {
                let mut decoded = Decoded::default();
                let start = &packet[..len];
                if decoder.decode_into(start, Trust::Start, &mut decoded).is_err() {
                    continue;
                }
                let what = format!("{rate:?}, {mode:?}, frame {number}, {len} of {}", packet.len());
                check(&decoded.truth, seen, &decoded.picture, &what);
                let seen = decoded.truth.count(TruthLevel::AsSeen);
                told += usize::from(len < packet.len() && seen > 0);
                if decoded.rows == 0 && Parsed::of(start).unwrap().residual(start).is_err() {
                    assert_eq!(seen, 0, "{what}: no difference picture came");
                }
            }
        }
    }
    assert!(told > 50, "{told} cut packets tell something");
}

#[test]
fn lost_packets_leave_no_untrue_map() {
    for lost in 1..FRAMES {
        let (mut decoder, frames) = dive(Rate::Bytes(200), Mode::Intra);
        for (number, (seen, encoded)) in frames.iter().enumerate() {
            if number == lost {
                continue;
            }
            let decoded = decoder.decode(&encoded.packet).unwrap();
            check(&decoded.truth, seen, &decoded.picture, &format!("{lost} lost, frame {number}"));
        }
        // A topside that joins late.
        let (engine, scene) = on_device(&wall(1));
        let mut late = Decoder::new(&engine, &scene);
        late.add_camera(&CAMERA).unwrap();
        let (seen, encoded) = &frames[lost];
        let decoded = late.decode(&encoded.packet).unwrap();
        check(&decoded.truth, seen, &decoded.picture, &format!("frame {lost} alone"));
    }
}

#[test]
fn damaged_packets_say_nothing() {
    let (mut decoder, frames) = dive(Rate::Bytes(200), Mode::Intra);
    let (_, encoded) = &frames[0];
    for at in encoded.packet.len() - 100..encoded.packet.len() {
        let mut packet = encoded.packet.clone();
        packet[at] ^= 0x10;
        let decoded = decoder.decode(&packet).unwrap();
        let size = (CAMERA.width, CAMERA.height);
        assert_eq!(decoded.truth, TruthMap::not_seen(size.0, size.1), "byte {at}");
    }
}

#[test]
fn without_a_map_nothing_is_known() {
    let (engine, scene) = on_device(&wall(1));
    for options in [
        EncoderOptions { truth: false, ..EncoderOptions::default() },
        EncoderOptions { rate: None, truth: true, ..EncoderOptions::default() },
    ] {
        let mut encoder = Encoder::new(&engine, &scene, &CAMERA, options).unwrap();
        let seen = frame(&engine, &scene, &pose(0.0));
        let encoded = encoder.encode(&seen, pose(0.0)).unwrap();
        assert_eq!(encoded.stats.truth_bytes, 0);
        let decoded = Decoder::new(&engine, &scene).decode(&encoded.packet).unwrap();
        assert_eq!(decoded.truth, TruthMap::not_seen(CAMERA.width, CAMERA.height));
    }
}

#[test]
fn every_budget_yields_a_packet() {
    for budget in (60..400).step_by(10) {
        let (_, frames) = dive(Rate::Bytes(budget), Mode::Intra);
        for (number, (_, encoded)) in frames.iter().enumerate() {
            let len = encoded.packet.len();
            assert!(len > budget / 2 && len <= budget, "{budget} bytes, frame {number}: {len}");
        }
    }
}
