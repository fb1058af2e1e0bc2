//! Vectors with keys: modem frames, reports and packets with numbers and tags, among those of strangers.

use nvsprior::{Prior, Rate};
use nvsprior_link::keys::{Authenticator, Content, Key, Keys};

use crate::dive::{CAMERA, Dive, How};
use crate::links;
use crate::vector::{Kind, Vector, VectorKeys};

const FIRST: [u8; 32] = *b"the first key of the test vector";
const SECOND: [u8; 32] = [0xA5; 32];
const STRANGE: [u8; 32] = [7; 32];

fn held(keys: &[[u8; 32]], tag_bytes: usize, epoch: u64) -> VectorKeys {
    VectorKeys { keys: keys.to_vec(), tag_bytes, epoch }
}

/// Puts numbers from `number` on and tags in front of some contents.
fn keyed(keys: &Keys, content: Content, number: u64, stream: u8, all: &[Vec<u8>]) -> Vec<Vec<u8>> {
    let keys = keys.clone().with_number(number).unwrap();
    let mut authenticator = Authenticator::new(&keys, content);
    let made = |bytes: &Vec<u8>| {
        let mut frame = Vec::new();
        authenticator.write(stream, bytes, &mut frame);
        frame
    };
    all.iter().map(made).collect()
}

fn by(key: [u8; 32], tag_bytes: usize, epoch: u64) -> Keys {
    let keys = Keys::new([Key::new(key)]).unwrap();
    keys.with_tag_bytes(tag_bytes).unwrap().with_epoch(epoch)
}

pub fn vectors(prior: &dyn Fn(&str) -> Prior) -> Vec<Vector> {
    let dive = Dive::of(prior("prior.ply"));
    vec![shares(&dive), small(&dive), change_of_keys(&dive), reports(), packets(&dive)]
}

/// Frames of the vehicle, padded by zeros, damaged, cut, once more, and those of strangers.
fn shares(dive: &Dive) -> Vector {
    let own = by(FIRST, 4, 9);
    let contents = links::usual(&dive.key(&CAMERA, 0));
    let mut records = keyed(&own, Content::Frame, 0, 0, &contents);
    let again = records.clone();
    let count = contents.len() as u64;
    let next =
        links::usual(&dive.coded(dive.short(&CAMERA, 1), None, 1, &How::at(Rate::Quality(40.0))));
    for (place, frame) in keyed(&own, Content::Frame, count, 0, &next).iter().enumerate() {
        let strange = match place % 6 {
            0 => keyed(&by(STRANGE, 4, 9), Content::Frame, 3, 0, &next[..1]).remove(0),
            1 => keyed(&by(FIRST, 4, 8), Content::Frame, count, 0, &next[..1]).remove(0),
            2 => keyed(&own, Content::Report, count, 0, &next[..1]).remove(0),
            3 => next[place].clone(),
            4 => frame[..frame.len() - 1].to_vec(),
            _ => again[place % again.len()].clone(),
        };
        records.push(strange);
        let mut damaged = frame.clone();
        damaged[place % frame.len()] ^= 0x10;
        records.push(damaged);
        // A modem fills it up with zeros.
        records.push([&frame[..], &vec![0; place % 4]].concat());
    }
    records.extend([vec![], vec![0; 5], again[0].clone()]);
    Vector {
        kind: links::kind(70, 1, 64),
        frames: links::FRAMES,
        keys: Some(held(&[FIRST], 4, 9)),
        ..Vector::packets("keyed-shares", "modem frames with keys, and those of strangers", records)
    }
}

/// The smallest modem frames that have room for number and tag.
fn small(dive: &Dive) -> Vector {
    let own = by(FIRST, 2, 1);
    let contents = links::split_all(&[dive.key(&CAMERA, 0), dive.key(&CAMERA, 1)], 8).concat();
    let mut records = keyed(&own, Content::Frame, 0, 0, &contents);
    records.push(records[3].clone());
    records.push(contents[0].clone());
    Vector {
        kind: links::kind(12, 1, 8),
        frames: links::FRAMES,
        keys: Some(held(&[FIRST], 2, 1)),
        ..Vector::packets("keyed-small", "modem frames of 12 bytes with keys", records)
    }
}

/// The vehicle goes over to the second key. Numbers jump, begin anew, come out of order, and are too old.
fn change_of_keys(dive: &Dive) -> Vector {
    let (first, second) = (by(FIRST, 8, u64::MAX), by(SECOND, 8, u64::MAX));
    let old = links::usual(&dive.key(&CAMERA, 0));
    let mut records = keyed(&first, Content::Frame, 200_000, 0, &old);
    let coded = |t| dive.coded(dive.short(&CAMERA, t), None, t, &How::at(Rate::Quality(30.0)));
    let later = keyed(&first, Content::Frame, 200_000 + 60_000, 0, &links::usual(&coded(1)));
    // Backwards, and those of before once more: they are long past.
    records.extend(later.iter().rev().cloned());
    records.extend(keyed(&first, Content::Frame, 200_000, 0, &old));
    let renewed = keyed(&second, Content::Frame, 5, 0, &links::usual(&coded(2)));
    records.extend(renewed.iter().cloned());
    // Beyond what is tried, and another stream.
    records.extend(keyed(&second, Content::Frame, 5 + 5 * 16_384, 0, &old[..1]));
    records.extend(keyed(&second, Content::Frame, 0, 3, &old[..1]));
    records.push(renewed[0].clone());
    Vector {
        kind: links::kind(76, 1, 64),
        frames: links::FRAMES,
        keys: Some(held(&[FIRST, SECOND], 8, u64::MAX)),
        ..Vector::packets("keyed-numbers", "a change of keys, and numbers of all kinds", records)
    }
}

fn reports() -> Vector {
    let own = by(FIRST, 2, 0);
    let contents = links::some_reports();
    let mut records = keyed(&own, Content::Report, 16_380, 2, &contents);
    records[1].extend([0; 9]);
    let again = records[0].clone();
    let mut damaged = records[2].clone();
    damaged[0] ^= 1;
    records.extend([again, damaged, contents[0].clone()]);
    records.extend(keyed(&own, Content::Frame, 16_384, 2, &contents[..1]));
    Vector {
        kind: Kind::Reports,
        keys: Some(held(&[FIRST], 2, 0)),
        ..Vector::packets("keyed-reports", "reports with keys, and others", records)
    }
}

fn packets(dive: &Dive) -> Vector {
    let own = by(FIRST, 16, 3);
    let coded = |t| dive.coded(dive.short(&CAMERA, t), None, t, &How::at(Rate::Quality(30.0)));
    let all: Vec<Vec<u8>> = (1..4).map(coded).collect();
    let mut records = keyed(&own, Content::Packet, 0, 0, &[dive.key(&CAMERA, 0)]);
    records.extend(keyed(&own, Content::Packet, 1, 0, &all));
    let padded = [&records[2][..], &[0]].concat();
    records.extend([records[1].clone(), padded, all[0].clone()]);
    // Files have no order: this one is far behind.
    records.extend(keyed(&own, Content::Packet, 300, 0, &all[2..]));
    records.extend(keyed(&own, Content::Packet, 100, 0, &all[1..2]));
    records.extend(keyed(&own, Content::Report, 7, 0, &all[1..2]));
    Vector {
        keys: Some(held(&[FIRST], 16, 3)),
        ..Vector::packets("keyed-packets", "packets in files with keys, and others", records)
    }
}
