use super::super::tests::sample_splats;
use super::super::{Prior, RenderOptions, RenderOverrides};
use super::*;

const NO_EXTRAS: Extras = Extras {
    key_frames: &KeyFrames::NONE,
    coder_tables: None,
    preprocessing: &Preprocessing::NONE,
};

/// A prior of splats along a line, and its blocked form in blocks of 8.
fn sample() -> (Prior, Vec<u8>, BlockedSummary) {
    let mut splats = sample_splats(100, 1);
    for (i, position) in splats.positions.iter_mut().enumerate() {
        position[0] += 3.0 * (i * 37 % 100) as f32;
    }
    splats.opacity_logits[7] = -12.0;
    let prior = Prior::from_splats(splats, RenderOptions::INRIA).unwrap();
    let mut bytes = Vec::new();
    let writer = BlockedWriter { block: 8, ..BlockedWriter::default() };
    let summary =
        writer.write(prior.splats(), prior.options(), &NO_EXTRAS, &mut bytes, &mut |_| ()).unwrap();
    (prior, bytes, summary)
}

/// A blocked prior in a file of its own.
fn opened(bytes: &[u8]) -> (tempfile::NamedTempFile, Result<BlockedPrior, PriorError>) {
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), bytes).unwrap();
    let blocked = BlockedPrior::open(file.path());
    (file, blocked)
}

/// With the check of the head as it should be.
fn checked(mut bytes: Vec<u8>) -> Vec<u8> {
    let head = u32::from_le_bytes(*bytes[8..].first_chunk().unwrap()) as usize;
    let check = crc32fast::hash(&bytes[..head - 4]);
    bytes[head - 4..head].copy_from_slice(&check.to_le_bytes());
    bytes
}

#[test]
fn a_site_is_the_prior_of_its_blocks() {
    let (prior, bytes, summary) = sample();
    let whole = Prior::from_bytes(&bytes, "blocked", &RenderOverrides::default()).unwrap();
    assert_eq!((whole.id(), whole.len()), (summary.id, prior.len() - 1), "one shows nothing");
    let (_file, blocked) = opened(&bytes);
    let blocked = blocked.unwrap();
    assert_eq!((blocked.id(), blocked.len()), (whole.id(), whole.len()));
    assert_eq!(blocked.coordinate_frame(), whole.coordinate_frame());
    assert_eq!((summary.blocks, summary.unseen), (blocked.blocks().len(), 1));
    assert!(blocked.blocks().len() >= 99 / 8);
    let mut splats = Splats { sh_degree: 1, ..Splats::default() };
    for index in 0..blocked.blocks().len() {
        splats.append(&mut blocked.read_block(index).unwrap());
    }
    assert_eq!(&splats, whole.splats());
}

#[test]
fn what_a_head_says_must_be_true() {
    let (_, bytes, _) = sample();
    let entry = 68;
    // The box, the longest splat, the number of splats, the radius, the clamp's flag.
    let shrink = |at: usize| {
        let mut bytes = bytes.clone();
        bytes[at..at + 4].copy_from_slice(&1e-6_f32.to_le_bytes());
        checked(bytes)
    };
    for at in [entry + 20, entry + 32, 64] {
        let (_file, blocked) = opened(&shrink(at));
        let first = blocked.and_then(|blocked| blocked.read_block(0));
        assert!(first.is_err(), "byte {at}");
        let whole = Prior::from_bytes(&shrink(at), "blocked", &RenderOverrides::default());
        assert!(whole.is_err(), "byte {at}");
    }
    let mut other = bytes.clone();
    other[12] ^= 1;
    let whole = Prior::from_bytes(&checked(other), "blocked", &RenderOverrides::default());
    assert!(whole.unwrap_err().to_string().contains("not"), "another identity");
}

#[test]
fn damage_is_found() {
    let (_, bytes, _) = sample();
    let head = u32::from_le_bytes(*bytes[8..].first_chunk().unwrap()) as usize;
    for at in 0..head {
        let mut other = bytes.clone();
        other[at] ^= 16;
        assert!(opened(&other).1.is_err(), "byte {at}");
    }
    for length in (0..bytes.len()).step_by(61) {
        assert!(opened(&bytes[..length]).1.is_err(), "{length} bytes");
    }
    let mut other = bytes.clone();
    other[head + 80] ^= 1;
    let error = opened(&other).1.unwrap().read_block(0).unwrap_err().to_string();
    assert!(error.contains("block 0"), "{error}");
}

#[test]
fn long_splats_come_to_blocks_of_their_own() {
    let mut splats = sample_splats(64, 0);
    for (i, position) in splats.positions.iter_mut().enumerate() {
        *position = [i as f32, 0.0, 0.0];
    }
    splats.log_scales.fill([-3.0; 3]);
    splats.log_scales[20] = [3.0, -3.0, -3.0];
    let blocks = divide::divide(&splats, (0..64).collect(), 16);
    let of_long = blocks.iter().find(|block| block.contains(&20)).unwrap();
    assert_eq!((of_long.len(), blocks.len()), (1, 5), "63 splats are halved twice");
}
