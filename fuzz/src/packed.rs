//! A file of a foreign format but plain PLY: an error or a valid prior.
use nvsprior::{Prior, RenderOverrides};

pub fn run(bytes: &[u8]) {
    let Ok(prior) = Prior::from_bytes(bytes, "input", &RenderOverrides::default()) else { return };
    assert!(prior.len() > 0);
}
