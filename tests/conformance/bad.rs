//! Vectors of packets that must be refused, or of which a part must not be used.

use nvsprior::packet::{Coder, Latent, PoseProfile, Residual};
use nvsprior::{Camera, Prior, Rate};

use crate::dive::{CAMERA, Dive, How, packet};
use crate::vector::Vector;

const CRC16: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740);
/// Bytes of the latent part of the full form with a compact pose, and of the short form.
const FULL: usize = 31;
const SHORT: usize = 19;

/// A packet with a byte changed.
fn flipped(packet: &[u8], at: usize, by: u8) -> Vec<u8> {
    let mut other = packet.to_vec();
    other[at] ^= by;
    other
}

/// A packet without a residual, whose latent part's byte is changed, and the check made right again.
pub fn resealed(packet: Vec<u8>, at: usize, by: u8) -> Vec<u8> {
    let len = packet.len();
    sealed(flipped(&packet, at, by), len)
}

/// Makes the check right of a latent part of `len` bytes.
fn sealed(mut packet: Vec<u8>, len: usize) -> Vec<u8> {
    let check = CRC16.checksum(&packet[..len - 2]);
    packet[len - 2..len].copy_from_slice(&check.to_le_bytes());
    packet
}

/// Makes the checks right of a packet in the short form that ends with a residual part.
pub fn rechecked(packet: Vec<u8>) -> Vec<u8> {
    let mut packet = sealed(packet, SHORT);
    let latent = crc32fast::hash(&packet[..SHORT]).to_le_bytes();
    let end = packet.len() - 2;
    let check = CRC16.checksum(&[&latent[..], &packet[SHORT..end]].concat());
    packet[end..].copy_from_slice(&check.to_le_bytes());
    packet
}

pub fn vectors(prior: &dyn Fn(&str) -> Prior) -> Vec<Vector> {
    let dive = Dive::of(prior("prior.ply"));
    [starts(&dive), latents(&dive), sessions(&dive), cameras(&dive), residuals(&dive)]
        .into_iter()
        .flatten()
        .collect()
}

fn none(latent: Latent) -> Vec<u8> {
    packet(latent, None, None, Residual::None)
}

fn starts(dive: &Dive) -> Vec<Vector> {
    let key = dive.key(&CAMERA, 0);
    let short = none(dive.short(&CAMERA, 1));
    let coded = dive.coded(
        dive.latent(&CAMERA, 2, PoseProfile::Compact),
        Some(&CAMERA),
        2,
        &How::at(Rate::Bytes(75)),
    );
    let truncated = (0..coded.len()).map(|len| coded[..len].to_vec()).collect();
    let magics = [0x00, 0x10, 0x8F, 0x82, 0xA1, 0xC4, 0xFF]
        .map(|first| [&[first][..], &short[1..]].concat());
    let versions = [0_u8, 3, 5, 6, 9, 10, 12, 15].into_iter().flat_map(|version| {
        let first = 0xB0 | version;
        let newer = |packet: &[u8], len: usize| sealed([&[first][..], &packet[1..]].concat(), len);
        [newer(&short, SHORT), newer(&key, FULL), [&[first][..], &short[1..]].concat()]
    });
    vec![
        Vector::packets("bad-truncated", "every start of a packet with all parts", truncated),
        Vector::packets(
            "bad-magic",
            "first bytes of no packet",
            [vec![key.clone()], magics.to_vec()].concat(),
        ),
        Vector::packets(
            "bad-version",
            "later versions, and garbage that looks like one",
            [vec![key.clone()], versions.collect()].concat(),
        ),
    ]
}

fn latents(dive: &Dive) -> Vec<Vector> {
    let key = dive.key(&CAMERA, 0);
    let short = none(dive.short(&CAMERA, 1));
    let full = none(dive.latent(&CAMERA, 1, PoseProfile::Compact));
    let paper = none(dive.latent(&CAMERA, 1, PoseProfile::Paper));
    let damaged = |packet: &[u8]| {
        (0..packet.len()).map(|at| flipped(packet, at, 1 << (at % 8))).collect::<Vec<_>>()
    };
    let many = |packets: Vec<Vec<u8>>| [vec![key.clone()], packets].concat();
    let set = |packet: &[u8], at: usize, bytes: &[u8]| {
        let mut other = packet.to_vec();
        other[at..at + bytes.len()].copy_from_slice(bytes);
        let len = other.len();
        sealed(other, len)
    };
    let nan = f32::NAN.to_le_bytes();
    vec![
        Vector::packets(
            "bad-check",
            "one bit of each byte of latent parts",
            many([damaged(&short), damaged(&full)].concat()),
        ),
        Vector::packets(
            "bad-profile",
            "unknown profiles of poses",
            many(vec![
                resealed(full.clone(), 1, 1),
                resealed(full.clone(), 1, 2),
                resealed(short.clone(), 1, 1),
                resealed(short.clone(), 1, 2),
            ]),
        ),
        Vector::packets(
            "bad-pose",
            "numbers that are no pose; the reserved bit of a short pose",
            many(vec![
                set(&short, 11, &[0xFF; 6]),
                set(&short, 11, &[0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0x7F]),
                set(&short, 11, &[0, 0, 0, 0, 0, 0x80]),
                set(&full, 21, &[0xFF; 7]),
                set(&full, 21, &[0; 7]),
                set(&paper, 12, &nan),
                set(&paper, 24, &[0; 16]),
            ]),
        ),
        Vector::packets(
            "bad-short-camera",
            "the short form has no camera part",
            many(vec![resealed(short.clone(), 1, 8)]),
        ),
        Vector::packets(
            "bad-coder",
            "codes that go with no small blocks",
            many(
                (0..8)
                    .map(|code| sealed([&[short[0], code << 4][..], &short[2..]].concat(), SHORT))
                    .collect(),
            ),
        ),
    ]
}

fn sessions(dive: &Dive) -> Vec<Vector> {
    let key = dive.key(&CAMERA, 0);
    let full = none(dive.latent(&CAMERA, 1, PoseProfile::Compact));
    let short = none(dive.short(&CAMERA, 1));
    let other = Camera { fx: 90.0, ..CAMERA };
    vec![
        Vector::packets(
            "bad-prior",
            "another prior",
            vec![key.clone(), resealed(full.clone(), 6, 1), full.clone()],
        ),
        Vector::packets(
            "bad-session",
            "short packets of an unknown session",
            vec![
                short.clone(),
                none(dive.short(&other, 2)),
                key.clone(),
                short,
                none(dive.short(&other, 3)),
            ],
        ),
        Vector::packets(
            "bad-camera-unknown",
            "a camera that never came",
            vec![
                full.clone(),
                key.clone(),
                none(dive.latent(&other, 1, PoseProfile::Compact)),
                full.clone(),
            ],
        ),
        Vector::packets(
            "bad-size",
            "a size that is not the camera's",
            vec![key, resealed(full.clone(), 9, 1), resealed(full, 10, 0x40)],
        ),
    ]
}

fn cameras(dive: &Dive) -> Vec<Vector> {
    let key = dive.key(&CAMERA, 0);
    let damaged = (FULL..key.len()).map(|at| flipped(&key, at, 0x10));
    // Numbers that are no camera's, with right checks.
    let nan = |value: f32| {
        let mut packet = key.clone();
        packet[FULL..FULL + 4].copy_from_slice(&value.to_le_bytes());
        let check = CRC16.checksum(&[&packet[9..12], &packet[FULL..FULL + 16]].concat());
        packet[FULL + 16..].copy_from_slice(&check.to_le_bytes());
        packet[FULL - 3] = check as u8;
        sealed(packet, FULL)
    };
    // A camera part that matches, but is not the one that the latent part names.
    let other = {
        let mut packet = key.clone();
        packet[FULL - 3] ^= 0x21;
        sealed(packet, FULL)
    };
    let numbers = vec![nan(f32::NAN), nan(-3.0), nan(0.0), other, key.clone(), nan(f32::INFINITY)];
    vec![
        Vector::packets(
            "bad-camera",
            "camera parts: one bit of each byte",
            damaged.chain([key.clone()]).collect(),
        ),
        Vector::packets("bad-camera-numbers", "camera parts that are no cameras", numbers),
    ]
}

fn residuals(dive: &Dive) -> Vec<Vector> {
    let key = dive.key(&CAMERA, 0);
    let coded = |t| dive.coded(dive.short(&CAMERA, t), None, t, &How::at(Rate::Bytes(90)));
    let (own, others) = (coded(1), coded(2));
    let damaged = (SHORT..own.len()).step_by(5).map(|at| flipped(&own, at, 0x20));
    let swapped = [&own[..SHORT], &others[SHORT..]].concat();
    let endless = [&own[..SHORT], &[0xFF; 8]].concat();
    let part = |code: u8, content: &[u8]| {
        let latent = Latent { frame: 5, ..dive.short(&CAMERA, 5) };
        let residual = Residual::Coded { coder: Coder::Wavelet, payload: content };
        let packet = packet(latent, None, None, residual);
        // The code is in the flags, the check over all: write both anew.
        rechecked([&[packet[0], 3 | code << 4][..], &packet[2..]].concat())
    };
    let contents = vec![
        part(5, &[]),
        part(5, &[3]),
        part(5, &[3, 1]),
        part(5, &[3, 1, 2, 9, 9]),
        part(5, &[0]),
        part(6, &[]),
        part(6, &[0b0110]),
        part(6, &[0b0110, 3, 1]),
        part(6, &[0b0000_0001]),
        part(6, &[0b0010_0000]),
        part(6, &[0b0110_0100, 2, 0x12, 0x34]),
        part(6, &[0b0001_1000, 0x31, 0x77]),
        part(6, &[0b0000_0111, 0x02, 1, 2, 1, 9, 9]),
        part(6, &[0b0000_0100, 0x0F, 0x80, 0x80, 0x80, 0, 0]),
        part(4, &[]),
    ];
    let many = |packets: Vec<Vec<u8>>| [vec![key.clone()], packets].concat();
    vec![
        Vector::packets(
            "bad-residual",
            "one bit of a residual part; that of another packet; an endless length",
            many(damaged.chain([swapped, endless, own.clone()]).collect()),
        ),
        Vector::packets(
            "bad-contents",
            "residual parts with right checks and odd contents",
            many(contents),
        ),
        Vector {
            needs: &["webp"],
            ..Vector::packets(
                "webp-bad",
                "VP8 payloads that are none",
                many(vec![part(2, &[1, 2]), part(2, &[0; 40]), part(3, b"RIFF")]),
            )
        },
    ]
}
