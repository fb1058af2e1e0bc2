//! Vectors of packets that must be refused, or of which a part must not be used.

use nvsprior::packet::{Latent, PoseProfile, Residual, SESSION_PART_LEN, SHORT_LATENT_LEN};
use nvsprior::{Camera, Prior, Rate};

use crate::dive::{CAMERA, Dive, How, packet};
use crate::vector::Vector;

const CRC16: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740);
/// Bytes of the latent part with a short pose, and with a compact one.
const SHORT: usize = SHORT_LATENT_LEN;
const COMPACT: usize = SHORT + 4;
/// Where the tag lies.
const TAG: std::ops::Range<usize> = 4..6;

/// A packet with a byte changed.
fn flipped(packet: &[u8], at: usize, by: u8) -> Vec<u8> {
    let mut other = packet.to_vec();
    other[at] ^= by;
    other
}

/// Makes the check right of a latent part of `len` bytes.
fn sealed(mut packet: Vec<u8>, len: usize) -> Vec<u8> {
    let check = CRC16.checksum(&packet[..len - 2]);
    packet[len - 2..len].copy_from_slice(&check.to_le_bytes());
    packet
}

/// Makes the checks right of a packet with a short pose whose residual part follows.
pub fn rechecked(packet: Vec<u8>) -> Vec<u8> {
    let mut packet = sealed(packet, SHORT);
    let latent = crc32fast::hash(&packet[..SHORT]).to_le_bytes();
    let check = CRC16.checksum(&[&latent[..], &packet[SHORT + 2..]].concat());
    packet[SHORT..SHORT + 2].copy_from_slice(&check.to_le_bytes());
    packet
}

/// With another head.
fn headed(packet: &[u8], head: [u8; 2]) -> Vec<u8> {
    [&head[..], &packet[2..]].concat()
}

pub fn vectors(prior: &dyn Fn(&str) -> Prior) -> Vec<Vector> {
    let dive = Dive::of(prior("prior.ply"));
    let other = Dive::of(prior("odd.ply"));
    [starts(&dive), latents(&dive), sessions(&dive, &other), session_parts(&dive), residuals(&dive)]
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
        &How::at(Rate::Bytes(80)),
    );
    let truncated = (0..coded.len()).map(|len| coded[..len].to_vec()).collect();
    // All kinds of poses that there are not.
    let words = (1..32).filter(|word| ![0b0_0111, 0b1_1001].contains(word));
    let kinds = words.map(|word| headed(&short, [word, short[1]]));
    // One that this version leaves to others keeps a check at 18 bytes, whatever its length.
    let later = |packet: &[u8], first: u8| sealed(headed(packet, [first, 0x5A]), 18);
    let versions = [
        later(&short[..18], 0b1_1110),
        later(&short, 0b0111_1110),
        later(&[&key[..], &[7; 90]].concat(), 0b1111_1110),
        later(&short, 0b1_1111),
        flipped(&later(&short, 0b1_1110), 9, 4),
        later(&short[..18], 0b1_1110)[..17].to_vec(),
        sealed(flipped(&short, 1, 0x40), SHORT),
        sealed(flipped(&short, 1, 0x80), SHORT),
        flipped(&sealed(flipped(&short, 1, 0x80), SHORT), 7, 1),
    ];
    vec![
        Vector::packets("bad-truncated", "every start of a packet with three parts", truncated),
        Vector::packets(
            "bad-pose-kind",
            "kinds of poses that there are not",
            [vec![key.clone()], kinds.collect()].concat(),
        ),
        Vector::packets(
            "bad-version",
            "later versions, and garbage that looks like one",
            [vec![key.clone()], versions.to_vec()].concat(),
        ),
    ]
}

fn latents(dive: &Dive) -> Vec<Vector> {
    let key = dive.key(&CAMERA, 0);
    let short = none(dive.short(&CAMERA, 1));
    let compact = none(dive.latent(&CAMERA, 1, PoseProfile::Compact));
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
    let coders = [(0, 1), (1, 1), (2, 1), (2, 2), (2, 3), (6, 1), (7, 2), (6, 3)];
    vec![
        Vector::packets(
            "bad-check",
            "one bit of each byte of latent parts",
            many([damaged(&short), damaged(&compact)].concat()),
        ),
        Vector::packets(
            "bad-pose",
            "numbers that are no pose; the reserved bit of a short pose",
            many(vec![
                set(&short, 12, &[0xFF; 6]),
                set(&short, 12, &[0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0x7F]),
                set(&short, 12, &[0, 0, 0, 0, 0, 0x80]),
                set(&compact, 15, &[0xFF; 7]),
                set(&compact, 15, &[0; 7]),
            ]),
        ),
        Vector::packets(
            "bad-coder",
            "contents that there are not",
            many(
                coders
                    .map(|(kind, flags)| sealed(headed(&short, [kind << 5, flags]), SHORT))
                    .to_vec(),
            ),
        ),
    ]
}

fn sessions(dive: &Dive, other: &Dive) -> Vec<Vector> {
    let key = dive.key(&CAMERA, 0);
    let short = |t| none(dive.short(&CAMERA, t));
    let camera = Camera { fx: 90.0, ..CAMERA };
    let strange = |t| none(dive.short(&camera, t));
    let coded = |t| dive.coded(dive.short(&CAMERA, t), None, t, &How::at(Rate::Bytes(90)));
    // Another prior's tag may be this one's: then the check of the latent part says nothing.
    let tagged = |t| none(Latent { tag: dive.short(&CAMERA, 0).tag, ..other.short(&CAMERA, t) });
    let damaged_key = flipped(&key, COMPACT + 8, 1);
    vec![
        Vector::packets(
            "estranged",
            "a packet about another prior: then none is shown until one states this prior",
            vec![
                key.clone(),
                short(1),
                other.key(&CAMERA, 2),
                short(3),
                tagged(4),
                coded(5),
                damaged_key,
                other.key(&CAMERA, 6),
                dive.key(&CAMERA, 7),
                short(8),
                coded(9),
            ],
        ),
        Vector::packets(
            "bad-prior",
            "another prior first; its tag is not known",
            vec![other.key(&CAMERA, 0), key.clone(), none(other.short(&CAMERA, 1)), short(2)],
        ),
        Vector::packets(
            "bad-session-unknown",
            "packets whose session never came",
            vec![short(1), strange(2), key.clone(), short(3), strange(4), short(5)],
        ),
        Vector::packets(
            "two-cameras",
            "two cameras in turn, each named by its tag",
            vec![key, dive.key(&camera, 1), short(2), strange(3), coded(4)],
        ),
    ]
}

/// Session parts that cannot be used.
fn session_parts(dive: &Dive) -> Vec<Vector> {
    let key = dive.key(&CAMERA, 0);
    let damaged = (COMPACT..key.len()).map(|at| flipped(&key, at, 0x10));
    // Numbers that are no camera's, with right checks.
    let with = |at: usize, value: f32| {
        let mut packet = key.clone();
        packet[COMPACT + at..COMPACT + at + 4].copy_from_slice(&value.to_le_bytes());
        let end = COMPACT + SESSION_PART_LEN - 2;
        let check = CRC16.checksum(&packet[COMPACT..end]);
        packet[end..].copy_from_slice(&check.to_le_bytes());
        let tag = crc32fast::hash(&packet[COMPACT..end]) as u16;
        (packet, tag)
    };
    let named = |(mut packet, tag): (Vec<u8>, u16)| {
        packet[TAG].copy_from_slice(&tag.to_le_bytes());
        sealed(packet, COMPACT)
    };
    // One whose tag is that of the camera that is known.
    let own = u16::from_le_bytes([key[TAG.start], key[TAG.start + 1]]);
    let collides = (0..1 << 22)
        .map(|bits| with(7, f32::from_bits(0x7FC0_0000 | bits)))
        .find(|(_, tag)| *tag == own)
        .unwrap();
    let numbers = [
        named(with(7, f32::NAN)),
        named(with(7, -3.0)),
        key.clone(),
        named(with(11, 0.0)),
        named(with(15, f32::INFINITY)),
        // A session part that matches, but is not the one that the latent part names.
        with(11, 77.0).0,
        sealed(flipped(&key, TAG.start, 0x21), COMPACT),
        collides.0,
        named(with(11, 77.0)),
    ];
    let cut = |len: usize| key[..key.len() - len].to_vec();
    vec![
        Vector::packets(
            "bad-session",
            "session parts: one bit of each byte, before the session is known and after; cut ones",
            damaged.clone().chain([key.clone()]).chain(damaged).chain([cut(1), cut(25)]).collect(),
        ),
        Vector::packets(
            "bad-session-numbers",
            "session parts that are none, or not the one that is named",
            numbers.to_vec(),
        ),
    ]
}

fn residuals(dive: &Dive) -> Vec<Vector> {
    let key = dive.key(&CAMERA, 0);
    let coded = |t| dive.coded(dive.short(&CAMERA, t), None, t, &How::at(Rate::Bytes(90)));
    let (own, others) = (coded(1), coded(2));
    let damaged = (SHORT..own.len()).step_by(5).map(|at| flipped(&own, at, 0x20));
    let swapped = [&own[..SHORT], &others[SHORT..]].concat();
    let longer = [&own[..], &[1]].concat();
    let short = none(dive.short(&CAMERA, 5));
    let part = |kind: u8, flags: u8, content: &[u8]| {
        let latent = headed(&short, [kind << 5, flags]);
        rechecked([&latent[..], &[0; 2], content].concat())
    };
    let (truth, small) = (2, 1);
    let contents = vec![
        part(3, 0, &[]),
        part(3, small, &[]),
        part(4, 0, &[]),
        part(4, small, &[]),
        part(5, 0, &[]),
        part(5, 0, &[3]),
        part(5, 0, &[3, 1]),
        part(5, 0, &[0, 1, 2]),
        part(5, 0, &[3, 1, 2, 9, 9]),
        part(5, truth, &[3, 1, 2]),
        part(5, truth, &[3, 1, 2, 0, 9, 9]),
        part(0, truth, &[]),
        part(0, truth, &[0b0000_0001]),
        part(0, truth, &[0b0000_0001, 3, 1]),
        part(0, truth, &[0b0000_1000]),
        part(1, truth, &[0b1000_0000]),
        part(0, truth, &[0b0000_0001, 2, 0x12, 0x34]),
        // Zeros at the end of a map are no padding.
        part(0, truth, &[0b0000_0001, 3, 0x12, 0, 0]),
        part(0, truth, &[0b0000_0101, 0x31, 0x77]),
        part(3, truth, &[0b0000_1001, 0x02, 1, 2, 1, 9, 9]),
        part(3, truth | small, &[0b0000_1010, 0x01, 7, 0xC0, 1]),
        part(0, truth, &[0b0000_0001, 0x0F, 0x80, 0x80, 0x80, 0, 0]),
        part(0, truth, &[0b0000_0001, 0x0F, 0xFF, 0xFF, 0xFF, 0, 0]),
    ];
    let many = |packets: Vec<Vec<u8>>| [vec![key.clone()], packets].concat();
    vec![
        Vector::packets(
            "bad-residual",
            "one bit of a residual part; that of another packet; a byte too many",
            many(damaged.chain([swapped, longer, own.clone()]).collect()),
        ),
        Vector::packets(
            "bad-contents",
            "residual parts with right checks and odd contents",
            many(contents),
        ),
    ]
}
