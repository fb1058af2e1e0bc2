//! Vectors of files of priors.

use nvsprior::Prior;
use nvsprior::prior::{Extras, KeyFrames, compact, with_extras};

use crate::dive;
use crate::vector::{Kind, Vector};

pub fn vectors() -> Vec<Vector> {
    let all = crate::priors();
    let file = |name: &str| all.iter().find(|(own, _)| *own == name).unwrap().1.clone();
    let [packed, tables, blocked] = ["prior.nvsg", "tables.nvsg", "blocked.nvsb"].map(file);
    let of = |name: &str, description, records| Vector {
        kind: Kind::Priors,
        ..Vector::packets(name, description, records)
    };
    let good = vec![
        packed.clone(),
        tables.clone(),
        blocked.clone(),
        exact(),
        full(&packed),
        full(&blocked),
        with_part(&packed, b"later\0\0\0", 0),
        far(),
        far_exact(),
    ];
    let bad = [bad_parts(&packed), bad_contents(&packed, &tables), bad_blocks(&blocked)].concat();
    vec![
        of("priors", "files of priors and their identities", good),
        of("priors-bad", "files of priors that must be refused", bad),
    ]
}

/// A prior whose splats are kept as they are.
fn exact() -> Vec<u8> {
    let (prior, mut bytes) = (dive::odd_prior(), Vec::new());
    compact::write_exact(prior.splats(), &prior.besides(), &mut bytes).unwrap();
    bytes
}

/// A PLY file of doubles far from the origin of its coordinates.
fn far() -> Vec<u8> {
    let names =
        "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    let properties = names.split(' ').map(|name| format!("property double {name}\n"));
    let row = |i: u32| {
        let along = f64::from(i);
        let [x, y, z] =
            [512_345.25 + 0.1 * along, 5_932_101.5 - 0.3 * along, -37.125 + 0.7 * along];
        format!("{x} {y} {z} 0.5 -0.25 0.125 2 -2 -3 -4 1 0.5 0 {along}\n")
    };
    let head = "ply\nformat ascii 1.0\nelement vertex 9\n".to_owned();
    let parts = [head].into_iter().chain(properties).chain(["end_header\n".to_owned()]);
    parts.chain((0..9).map(row)).collect::<String>().into_bytes()
}

/// The same as a file of our own, which states the origin.
fn far_exact() -> Vec<u8> {
    let prior = Prior::from_bytes(&far(), "vector", &Default::default()).unwrap();
    assert_ne!(prior.origin(), Default::default());
    let mut bytes = Vec::new();
    compact::write_exact(prior.splats(), &prior.besides(), &mut bytes).unwrap();
    bytes
}

/// The file with doubt, a record and other key frames.
fn full(file: &[u8]) -> Vec<u8> {
    let splats = Prior::from_bytes(file, "vector", &Default::default()).unwrap().len();
    let extras = Extras {
        key_frames: KeyFrames::new((0..4).map(dive::pose).collect()).unwrap(),
        doubt: Some((0..splats).map(|splat| splat as u8).collect()),
        record: Some("a record".into()),
        ..Extras::default()
    };
    with_extras(file, &extras).unwrap()
}

const HEAD: usize = 28;
/// Bytes of a part before its content, and of these before its check.
const START: usize = 21;
const CHECKED: usize = 17;

pub fn with(bytes: &[u8], at: usize, by: u8) -> Vec<u8> {
    let mut other = bytes.to_vec();
    other[at] ^= by;
    other
}

/// Where each part begins, and its length.
fn parts(bytes: &[u8]) -> Vec<(usize, usize)> {
    let end = u64::from_le_bytes(*bytes[16..].first_chunk().unwrap()) as usize;
    let (mut at, mut parts) = (HEAD, Vec::new());
    while at < end {
        let length = u64::from_le_bytes(*bytes[at + 9..].first_chunk().unwrap()) as usize;
        parts.push((at, length));
        at += START + length;
    }
    parts
}

/// Where the part of a name begins.
fn part(bytes: &[u8], name: &[u8]) -> usize {
    let found = parts(bytes).into_iter().find(|(at, _)| bytes[*at..].starts_with(name));
    found.expect("a part").0
}

/// Where the content of a part begins.
fn content(bytes: &[u8], name: &[u8]) -> usize {
    part(bytes, name) + START
}

/// A byte changed, and the checks of head and parts made right again.
fn edited(bytes: &[u8], at: usize, by: u8) -> Vec<u8> {
    let (places, mut bytes) = (parts(bytes), with(bytes, at, by));
    let check = crc32fast::hash(&bytes[..HEAD - 4]);
    bytes[HEAD - 4..HEAD].copy_from_slice(&check.to_le_bytes());
    for (at, length) in places {
        let content = &bytes[at + START..at + START + length];
        let check = crc32fast::hash(&[&bytes[at..at + CHECKED], content].concat());
        bytes[at + CHECKED..at + START].copy_from_slice(&check.to_le_bytes());
    }
    bytes
}

/// With one part more.
fn with_part(bytes: &[u8], name: &[u8; 8], flags: u8) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    let start = [&name[..], &[flags], &3_u64.to_le_bytes()].concat();
    bytes.extend(&start);
    bytes.extend(crc32fast::hash(&[&start[..], b"new"].concat()).to_le_bytes());
    bytes.extend(b"new");
    let (count, end) = (parts(&bytes).len() as u16 + 1, bytes.len() as u64);
    bytes[6..8].copy_from_slice(&count.to_le_bytes());
    bytes[16..24].copy_from_slice(&end.to_le_bytes());
    edited(&bytes, 0, 0)
}

/// Files whose head or parts are not right.
fn bad_parts(packed: &[u8]) -> Vec<Vec<u8>> {
    let first = HEAD;
    vec![
        with(packed, 0, 1),
        with(packed, 9, 1),
        with(packed, packed.len() - 1, 1),
        packed[..20].to_vec(),
        packed[..packed.len() - 1].to_vec(),
        [packed, &[0]].concat(),
        // Version, degree, number of parts, identity, splats, end of the parts.
        edited(packed, 4, 2),
        edited(packed, 5, 4),
        edited(packed, 6, 1),
        edited(packed, 8, 1),
        edited(packed, 14, 1),
        edited(packed, 17, 1),
        // A name, flags.
        edited(packed, first, 0x20),
        edited(packed, first + 8, 2),
        with_part(packed, b"later\0\0\0", 1),
        with_part(packed, b"later\0\0\0", 2),
        with_part(packed, b"later\0\0\0", 3),
        with_part(packed, b"later\0\0\0", 4),
        with_part(packed, b"options\0", 3),
        with_part(packed, b"tables\0\0", 3),
    ]
}

/// Files whose parts hold what no writer leaves there.
fn bad_contents(packed: &[u8], tables: &[u8]) -> Vec<Vec<u8>> {
    let [options, keys, splats] = [&b"options"[..], b"keys", b"splats"].map(|n| content(packed, n));
    vec![
        edited(packed, options + 3, 0x80),
        edited(packed, options + 24, 2),
        edited(packed, options, 1),
        edited(packed, keys + 2, 0xFF),
        edited(packed, keys + 7, 0x80),
        edited(packed, splats + 15, 0x40),
        edited(packed, splats + 19, 0x80),
        edited(tables, content(tables, b"tables") + 200, 1),
        edited(tables, content(tables, b"tables"), 1),
    ]
}

/// Blocked priors whose parts or blocks are not right.
fn bad_blocks(blocked: &[u8]) -> Vec<Vec<u8>> {
    let (frame, blocks) = (content(blocked, b"frame"), content(blocked, b"blocks"));
    let end = u64::from_le_bytes(*blocked[16..].first_chunk().unwrap()) as usize;
    vec![
        with(blocked, 20, 1),
        blocked[..27].to_vec(),
        blocked[..end - 1].to_vec(),
        blocked[..blocked.len() - 1].to_vec(),
        [blocked, &[0]].concat(),
        with(blocked, end + 300, 1),
        edited(blocked, 8, 1),
        edited(blocked, 12, 1),
        edited(blocked, frame + 15, 0x80),
        edited(blocked, blocks + 3, 0x80),
        edited(blocked, blocks + 4, 2),
        // A block's box, then its longest splat, a quarter or less of what it was.
        edited(blocked, blocks + 5 + 12 + 3, 0x80),
        edited(blocked, blocks + 5 + 36 + 3, 0x02),
    ]
}
