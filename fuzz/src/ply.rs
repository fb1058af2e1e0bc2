//! A prior's file: an error or a valid prior.
use nvsprior::prior::ply::write_ply;
use nvsprior::{Prior, RenderOverrides};

pub fn run(bytes: &[u8]) {
    let Ok(prior) = Prior::from_bytes(bytes, "input", &RenderOverrides::default()) else { return };
    assert!(prior.len() > 0);
    // What was read is written and read again as the same prior.
    let mut file = Vec::new();
    let (splats, options, key_frames) = (prior.splats(), prior.options(), prior.key_frames());
    let preprocessing = prior.preprocessing();
    write_ply(splats, options, key_frames, preprocessing, &mut file).expect("memory takes it");
    let again = Prior::from_bytes(&file, "again", &RenderOverrides::default());
    let again = again.expect("what was written can be read");
    assert_eq!(again.id(), prior.id());
    assert_eq!(again.key_frames(), key_frames);
    assert_eq!(again.preprocessing(), preprocessing);
}
