use proptest::prelude::*;

use super::*;
use crate::prior::key_frames::tests::sample_key_frames;
use crate::prior::{Extras, KeyFrames, Prior, PriorError, PriorId};

/// A file with key frames and a record.
fn sample() -> Vec<u8> {
    let extras = Extras {
        key_frames: sample_key_frames(3),
        record: Some("line".into()),
        ..Extras::default()
    };
    let mut file = Container::new(Head::new(Format::Beside, 1, 5, PriorId(7)));
    extras.put(&mut file);
    file.to_bytes()
}

fn read(bytes: &[u8]) -> Result<Extras, PriorError> {
    Extras::read(&Container::read(bytes, Format::Beside)?)
}

/// The sample with one more part of any name and flags.
fn with_part(name: &[u8; 8], flags: u8) -> Vec<u8> {
    let mut bytes = sample();
    let mut start = [&name[..], &[flags], &3_u64.to_le_bytes()].concat();
    let check = crc32fast::hash(&[&start[..], b"abc"].concat());
    start.extend(check.to_le_bytes());
    bytes.extend([&start[..], b"abc"].concat());
    headed(bytes)
}

/// With a head that counts one part more.
fn headed(mut bytes: Vec<u8>) -> Vec<u8> {
    let head = Head::read(&bytes, Format::Beside, u64::MAX).unwrap();
    let head = Head { parts: head.parts + 1, end: bytes.len() as u64, ..head };
    bytes[..Head::BYTES].copy_from_slice(&head.to_bytes());
    bytes
}

#[test]
fn parts_come_back() {
    let bytes = sample();
    let file = Container::read(&bytes, Format::Beside).unwrap();
    assert_eq!((file.head.sh_degree, file.head.splats, file.head.id), (1, 5, PriorId(7)));
    let extras = read(&bytes).unwrap();
    assert_eq!((extras.key_frames.len(), extras.record.as_deref()), (3, Some("line")));
    assert_eq!(file.to_bytes(), bytes);
}

#[test]
fn every_flipped_bit_and_every_cut_is_noticed() {
    let bytes = sample();
    for bit in 0..bytes.len() * 8 {
        let mut damaged = bytes.clone();
        damaged[bit / 8] ^= 1 << (bit % 8);
        assert!(read(&damaged).is_err(), "bit {bit}");
    }
    for length in 0..bytes.len() {
        assert!(read(&bytes[..length]).is_err(), "{length} bytes");
    }
}

#[test]
fn unknown_parts_are_passed_over_unless_they_must_be_understood() {
    let bytes = with_part(b"new\0\0\0\0\0", 0);
    assert_eq!(read(&bytes).unwrap(), read(&sample()).unwrap());
    // They stay when others are replaced.
    let mut file = Container::read(&bytes, Format::Beside).unwrap();
    file.set(PartName::RECORD, None);
    file.set(PartName::KEY_FRAMES, None);
    let bytes = file.to_bytes();
    assert_eq!(bytes.len(), Head::BYTES + 21 + 3);
    assert_eq!(read(&bytes).unwrap().key_frames, KeyFrames::NONE);
    for flags in [2, 3] {
        let error = read(&with_part(b"newer\0\0\0", flags)).unwrap_err();
        assert!(matches!(&error, PriorError::UnknownPart { part } if part == "\"newer\""));
        assert!(error.to_string().contains("\"newer\""), "{error}");
    }
}

#[test]
fn what_no_writer_leaves_is_refused() {
    let at = sample().len() as u64;
    let offset = |bytes: &[u8]| match read(bytes) {
        Err(PriorError::Field { offset, .. }) => offset,
        other => panic!("{other:?}"),
    };
    // Flags: covered by the identity, but not to be understood; unknown bits; those of another part.
    assert_eq!(offset(&with_part(b"new\0\0\0\0\0", 1)), at + 8);
    assert_eq!(offset(&with_part(b"new\0\0\0\0\0", 4)), at + 8);
    assert_eq!(offset(&with_part(b"doubt\0\0\0", 3)), at + 8);
    // Names.
    for name in [b"New\0\0\0\0\0", b"\0\0\0\0\0\0\0\0", b"a\0b\0\0\0\0\0", b"a b\0\0\0\0\0"] {
        assert_eq!(offset(&with_part(name, 0)), at, "{name:?}");
    }
    assert_eq!(offset(&with_part(b"keys\0\0\0\0", 0)), at);
    // A part is damaged, and named.
    let mut bytes = sample();
    let last = bytes.len() - 1;
    bytes[last] ^= 1;
    let error = read(&bytes).unwrap_err().to_string();
    assert!(error.starts_with("part \"record\": damaged"), "{error}");
    // More bytes than parts.
    let mut bytes = sample();
    bytes.push(0);
    let head = Head::read(&bytes, Format::Beside, at + 1).unwrap();
    let head = Head { end: at + 1, ..head };
    bytes[..Head::BYTES].copy_from_slice(&head.to_bytes());
    assert_eq!(offset(&bytes), at);
    let newer = [&b"nvsx\x02"[..], &[0; 60]].concat();
    assert!(matches!(read(&newer), Err(PriorError::Newer { version: 2, known: 1, .. })));
    assert!(matches!(read(&sample()[1..]), Err(PriorError::UnknownFormat)));
    let compact = Prior::from_bytes(&sample(), "beside", &Default::default());
    assert!(compact.is_err(), "no prior");
}

proptest! {
    #[test]
    fn arbitrary_parts_are_an_error_or_extras(
        name in prop::sample::select(vec!["keys", "treated", "lens", "filter", "doubt", "record"]),
        content in proptest::collection::vec(any::<u8>(), 0..200),
    ) {
        let mut bytes = Head::new(Format::Beside, 0, 5, PriorId(1)).to_bytes().to_vec();
        let padded: [u8; 8] = std::array::from_fn(|i| name.as_bytes().get(i).copied().unwrap_or(0));
        let start = [&padded[..], &[0], &(content.len() as u64).to_le_bytes()].concat();
        bytes.extend(&start);
        bytes.extend(crc32fast::hash(&[&start[..], &content].concat()).to_le_bytes());
        bytes.extend(&content);
        if let Ok(extras) = read(&headed(bytes)) {
            let mut file = Container::new(Head::new(Format::Beside, 0, 5, PriorId(1)));
            extras.put(&mut file);
            prop_assert_eq!(read(&file.to_bytes()).unwrap(), extras);
        }
    }
}
