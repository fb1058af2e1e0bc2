//! A prior's file: an error or a sound prior.
#![no_main]

use libfuzzer_sys::fuzz_target;
use nvsprior::prior::ply::write_ply;
use nvsprior::{Prior, RenderOverrides};

fuzz_target!(|bytes: &[u8]| {
    let Ok(prior) = Prior::from_bytes(bytes, "input", &RenderOverrides::default()) else { return };
    assert!(prior.len() > 0);
    // What was read is written and read again as the same prior.
    let mut file = Vec::new();
    write_ply(prior.splats(), prior.options(), &mut file).expect("memory takes it");
    let again = Prior::from_bytes(&file, "again", &RenderOverrides::default());
    assert_eq!(again.expect("what was written can be read").id(), prior.id());
});
