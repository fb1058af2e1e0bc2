//! What elements tell of how far a picture is from what the camera saw.

use nvsprior::Decoded;
use nvsprior::truth::{BLOCK, TruthLevel};

use super::regions::{name_of, regions};

/// The truth map of a picture, for a message of this name.
pub fn truth(name: &str, decoded: &Decoded) -> gst::Structure {
    let map = &decoded.truth;
    let share = |level| map.count(level) as f64 / map.levels.len().max(1) as f64;
    let mut truth = gst::Structure::builder(name)
        .field("frame", decoded.frame)
        .field("columns", map.columns)
        .field("rows", map.rows)
        .field("block", BLOCK)
        .field("as-seen", share(TruthLevel::AsSeen))
        .field("differs", share(TruthLevel::Differs))
        .field("wrong", share(TruthLevel::Wrong))
        .field("not-seen", share(TruthLevel::NotSeen))
        .field("levels", gst::glib::Bytes::from(&map.levels))
        .build();
    if let Some([differs, wrong]) = map.thresholds {
        truth.set("differs-above", f64::from(differs));
        truth.set("wrong-above", f64::from(wrong));
    }
    truth
}

/// Marks the regions of a picture that are not as the camera saw them.
pub(super) fn mark_regions(decoded: &Decoded, buffer: &mut gst::BufferRef) {
    let size = (decoded.picture.width, decoded.picture.height);
    for region in regions(&decoded.truth, size) {
        if let Some(name) = name_of(region.level) {
            gst_video::VideoRegionOfInterestMeta::add(buffer, name, region.rectangle);
        }
    }
}
