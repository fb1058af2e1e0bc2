use super::super::container::{Container, PartName};
use super::super::tests::sample_splats;
use super::super::{Extras, Prior, RenderOptions, RenderOverrides, with_extras};
use super::*;

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
    let summary = writer.write(prior.splats(), &prior.besides(), &mut bytes, &mut |_| ()).unwrap();
    (prior, bytes, summary)
}

/// A blocked prior in a file of its own.
fn opened(bytes: &[u8]) -> (tempfile::NamedTempFile, Result<BlockedPrior, PriorError>) {
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), bytes).unwrap();
    let blocked = BlockedPrior::open(file.path());
    (file, blocked)
}

/// With the part of the blocks changed.
fn changed(bytes: &[u8], change: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    let mut file = Container::read(bytes, Format::Blocked).unwrap();
    let mut content = file.part(PartName::BLOCKS).unwrap().content.to_vec();
    change(&mut content);
    file.set(PartName::BLOCKS, Some(content));
    [file.to_bytes(), bytes[file.head.end as usize..].to_vec()].concat()
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
    let entry = 5;
    // The box, the longest splat, the radius.
    for at in [entry + 24, entry + 36, 0] {
        let small = 1e-6_f32.to_le_bytes();
        let other = changed(&bytes, |content| content[at..at + 4].copy_from_slice(&small));
        let (_file, blocked) = opened(&other);
        let first = blocked.and_then(|blocked| blocked.read_block(0));
        assert!(first.is_err(), "byte {at}");
        let whole = Prior::from_bytes(&other, "blocked", &RenderOverrides::default());
        assert!(whole.is_err(), "byte {at}");
    }
    let fewer = changed(&bytes, |content| content.truncate(entry + 40));
    assert!(opened(&fewer).1.is_err(), "bytes behind the last block");
    let mut other = bytes.clone();
    let head = Head::read(&bytes, Format::Blocked, u64::MAX).unwrap();
    let head = Head { id: PriorId(head.id.0 ^ 1), ..head };
    other[..Head::BYTES].copy_from_slice(&head.to_bytes());
    let whole = Prior::from_bytes(&other, "blocked", &RenderOverrides::default());
    assert!(whole.unwrap_err().to_string().contains("not"), "another identity");
}

#[test]
fn extras_are_put_in_and_taken_out() {
    let (_, bytes, summary) = sample();
    let doubt = (0..summary.splats).map(|splat| splat as u8).collect();
    let extras = Extras { doubt: Some(doubt), record: Some("r".into()), ..Extras::default() };
    let with = with_extras(&bytes, &extras).unwrap();
    let (_file, blocked) = opened(&with);
    let blocked = blocked.unwrap();
    assert_eq!((blocked.extras(), blocked.id()), (&extras, summary.id));
    blocked.read_block(blocked.blocks().len() - 1).unwrap();
    let whole = Prior::from_bytes(&with, "blocked", &RenderOverrides::default()).unwrap();
    assert_eq!((whole.extras(), whole.id()), (&extras, summary.id));
    assert_eq!(with_extras(&with, &Extras::default()).unwrap(), bytes);
}

#[test]
fn damage_is_found() {
    let (_, bytes, _) = sample();
    let head = Head::read(&bytes, Format::Blocked, u64::MAX).unwrap().end as usize;
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
    assert!(error.contains("block 0") && error.contains("damaged"), "{error}");
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
