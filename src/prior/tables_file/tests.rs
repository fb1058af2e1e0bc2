use proptest::prelude::*;

use super::super::tests::sample_splats;
use super::super::{KeyFrames, PartSource, Prior, RenderOptions, RenderOverrides};
use super::*;
use crate::image::Preprocessing;
use crate::random::Random;

pub(crate) fn sample_tables(seed: u64) -> Tables {
    let mut random = Random::new(seed);
    let mut bytes = Tables::zero().write();
    bytes[4..].iter_mut().for_each(|byte| *byte = random.bits() as u8);
    Tables::read(&bytes).unwrap()
}

/// A folder with `p.ply`, and the prior's path.
pub(crate) fn folder() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("p.ply");
    let mut bytes = Vec::new();
    let (splats, options) = (sample_splats(2, 0), RenderOptions::INRIA);
    super::super::ply::write_ply(
        &splats,
        &options,
        &KeyFrames::NONE,
        &Preprocessing::NONE,
        &mut bytes,
    )
    .unwrap();
    std::fs::write(&path, bytes).unwrap();
    (folder, path)
}

#[test]
fn those_beside_a_prior_are_read_with_it_and_name_another_one() {
    let (_folder, path) = folder();
    let read = || Prior::open(&path, &RenderOverrides::default()).unwrap();
    let plain = read();
    assert!(plain.coder_tables().is_none());
    assert_eq!(plain.report().coder_tables, PartSource::None);
    let beside = path_beside(&path);
    assert!(beside.to_str().unwrap().ends_with("p.ply.tables"));
    let tables = sample_tables(1);
    save(&tables, &beside).unwrap();
    assert_eq!(open(&beside).unwrap(), tables);
    let with = read();
    assert_eq!(with.coder_tables().map(|t| &**t), Some(&tables));
    assert_eq!(with.report().coder_tables, PartSource::Beside);
    assert!(with.id() != plain.id() && with.splats() == plain.splats());
    // The same tables, given in memory, and removed again.
    let memory = plain.clone().with_coder_tables(Some(tables));
    assert_eq!((memory.id(), memory.report().coder_tables), (with.id(), PartSource::Memory));
    let none = memory.with_coder_tables(None);
    assert_eq!((none.id(), none.report().coder_tables), (plain.id(), PartSource::None));
    // Render options count besides.
    let overrides = RenderOverrides { near: Some(0.5), ..RenderOverrides::default() };
    assert_ne!(Prior::open(&path, &overrides).unwrap().id(), with.id());
}

#[test]
fn those_beside_a_prior_come_before_those_in_its_file() {
    let (folder, path) = folder();
    let splats = Prior::open(&path, &RenderOverrides::default()).unwrap().splats().clone();
    let compact = folder.path().join("p.nvsg");
    let mut bytes = Vec::new();
    let (options, none) = (RenderOptions::INRIA, KeyFrames::NONE);
    let write = super::super::compact::write;
    write(&splats, &options, &none, &Default::default(), &mut bytes).unwrap();
    let inside = super::super::compact::with_coder_tables(&bytes, Some(&sample_tables(1)));
    std::fs::write(&compact, inside.unwrap()).unwrap();
    let read = || Prior::open(&compact, &RenderOverrides::default()).unwrap();
    let inside = read();
    assert_eq!(inside.report().coder_tables, PartSource::InFile);
    save(&sample_tables(2), &path_beside(&compact)).unwrap();
    let beside = read();
    assert_eq!(beside.report().coder_tables, PartSource::Beside);
    assert_eq!(beside.coder_tables().map(|t| &**t), Some(&sample_tables(2)));
    assert_ne!(beside.id(), inside.id());
}

#[test]
fn a_broken_file_beside_a_prior_is_named() {
    let (_folder, path) = folder();
    let beside = path_beside(&path);
    let error = || Prior::open(&path, &RenderOverrides::default()).unwrap_err().to_string();
    let valid = sample_tables(1).write();
    let (max, short) = (valid.len(), valid.len() - 1);
    std::fs::write(&beside, b"NVT0").unwrap();
    assert!(error().contains("p.ply.tables: coder tables, byte 0: no coder tables"), "{}", error());
    std::fs::write(&beside, &valid[..short]).unwrap();
    let named = format!(
        "p.ply.tables: coder tables, byte {short}: coder tables of {short} bytes, {max} expected"
    );
    assert!(error().ends_with(&named), "{}", error());
    std::fs::write(&beside, [&valid[..], &[0]].concat()).unwrap();
    assert!(error().contains("p.ply.tables: too long for a file of coder tables"), "{}", error());
    std::fs::remove_file(&beside).unwrap();
    std::fs::create_dir(&beside).unwrap();
    assert!(error().contains("p.ply.tables: no file of coder tables"), "{}", error());
}

proptest! {
    #[test]
    fn arbitrary_files_are_an_error_or_tables(
        bytes in proptest::collection::vec(any::<u8>(), 0..200),
        whole in proptest::collection::vec(any::<u8>(), Tables::encoded_len()),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.tables");
        std::fs::write(&path, bytes).unwrap();
        prop_assert!(open(&path).is_err());
        let whole = [b"NVT1", &whole[4..]].concat();
        std::fs::write(&path, &whole).unwrap();
        prop_assert_eq!(open(&path).unwrap().write(), whole);
    }
}
