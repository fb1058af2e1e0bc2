//! What `nvspdec` tells of how far a picture is from what the camera saw.

use gst::prelude::*;
use gst::subclass::prelude::*;

use nvsprior::Decoded;
use nvsprior::truth::{BLOCK, TruthLevel};

use crate::decoder::regions::{name_of, regions};
use crate::stats;

use super::Decoder;

impl Decoder {
    /// Posts the truth map of a picture.
    pub(super) fn post_truth(&self, decoded: &Decoded) {
        let map = &decoded.truth;
        let share = |level| map.count(level) as f64 / map.levels.len().max(1) as f64;
        let mut truth = gst::Structure::builder("nvspdec-truth")
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
        stats::post(self.obj().upcast_ref(), truth);
    }
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
