//! A compact prior: an error or a sound prior. The check at the end is made to fit first, or nothing
//! behind it would ever be reached.
use nvsprior::prior::compact::{self, Quantisation};
use nvsprior::{Prior, RenderOverrides};

pub fn run(bytes: &[u8]) {
    let _ = compact::read(bytes);
    let content = &bytes[..bytes.len().saturating_sub(4)];
    let file = [content, &crc32fast::hash(content).to_le_bytes()].concat();
    let Ok(prior) = Prior::from_bytes(&file, "input", &RenderOverrides::default()) else { return };
    // What was read is written and read again as the prior that the writer names.
    let (splats, options) = (prior.splats(), prior.options());
    let mut again = Vec::new();
    let quantisation = Quantisation::default();
    let Ok(id) = compact::write(splats, options, &quantisation, &mut again) else { return };
    let again = Prior::from_bytes(&again, "again", &RenderOverrides::default());
    assert_eq!(again.expect("what was written can be read").id(), id);
}
