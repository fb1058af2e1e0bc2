//! A compact prior: an error or a sound prior. The check at the end is made to fit first, or nothing
//! behind it would ever be reached.
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
    let without = compact::with_key_frames(&file, &KeyFrames::NONE).expect("what could be read");
    let without = Prior::from_bytes(&without, "without", &RenderOverrides::default());
    assert_eq!(without.expect("the same splats").id(), prior.id());
}
