//! A compact prior: must give an error or a valid prior. The check at the end is made to match first, else no input
//! would get past it.
use nvsprior::coder_tables::Tables;
use nvsprior::image::Preprocessing;
use nvsprior::prior::KeyFrames;
use nvsprior::prior::compact::{self, Quantisation};
use nvsprior::{Prior, RenderOverrides};

pub fn run(bytes: &[u8]) {
    let _ = compact::read(bytes);
    let content = &bytes[..bytes.len().saturating_sub(4)];
    let file = [content, &crc32fast::hash(content).to_le_bytes()].concat();
    let Ok(prior) = Prior::from_bytes(&file, "input", &RenderOverrides::default()) else { return };
    // What was read is written and read again as the prior that the writer names.
    let (splats, options, key_frames) = (prior.splats(), prior.options(), prior.key_frames());
    let mut again = Vec::new();
    let quantisation = Quantisation::default();
    let written = compact::write(splats, options, key_frames, &quantisation, &mut again);
    let Ok(id) = written else { return };
    let again = Prior::from_bytes(&again, "again", &RenderOverrides::default());
    let again = again.expect("what was written can be read");
    assert_eq!((again.id(), again.key_frames().len()), (id, key_frames.len()));
    let open = |bytes: &[u8]| {
        Prior::from_bytes(bytes, "changed", &RenderOverrides::default()).expect("the same splats")
    };
    let without = compact::with_key_frames(&file, &KeyFrames::NONE).expect("what could be read");
    assert_eq!(open(&without).id(), prior.id());
    // Coder tables are put in, and taken out again.
    let tables = prior.coder_tables().map(AsRef::as_ref);
    let generic = Tables::generic();
    let with = compact::with_coder_tables(&file, Some(&generic)).expect("what could be read");
    assert_eq!(open(&with).coder_tables().map(AsRef::as_ref), Some(&generic));
    assert!(tables == Some(&generic) || open(&with).id() != prior.id());
    let back = compact::with_coder_tables(&with, tables).expect("what was written");
    assert_eq!(open(&back).id(), prior.id());
    // The preprocessing stays with all of that, and can be taken out.
    for changed in [&without, &with, &back] {
        assert_eq!(open(changed).preprocessing(), prior.preprocessing());
    }
    let none = compact::with_preprocessing(&file, &Preprocessing::NONE).expect("what was written");
    assert!(open(&none).preprocessing().is_none());
    assert_eq!(open(&none).id(), prior.id());
}
