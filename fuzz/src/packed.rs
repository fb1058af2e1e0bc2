//! A file of a foreign format but plain PLY: an error or a valid prior.
use nvsprior::RenderOverrides;

pub fn run(bytes: &[u8]) {
    let Ok(prior) = nvsprior_formats::from_bytes(bytes, "input", &RenderOverrides::default())
    else {
        return;
    };
    assert!(prior.len() > 0);
}
