//! What the elements that encode frames share.

mod image;
mod properties;
mod settings;
mod views;

pub use image::{FORMATS, view};
pub(crate) use properties::coding_element;
pub use settings::{Coding, ModeKind, StructureKind, TuneKind};
pub use views::{SetUpError, Views};

use nvsprior::Encoded;

/// The figures of a packet, for a message of this name.
pub fn figures(name: &str, encoded: &Encoded) -> gst::Structure {
    let stats = &encoded.stats;
    let mut figures = gst::Structure::builder(name)
        .field("frame", stats.frame)
        .field("bytes", stats.bytes as u32)
        .field("pose-bytes", stats.latent_bytes as u32)
        .field("psnr", stats.psnr)
        .field("render-psnr", stats.render_psnr)
        .field("certain", stats.certain)
        .field("lost-frames", stats.frames_since_certain)
        .field("rate-kept", stats.rate_kept)
        .field("truth-bytes", stats.truth_bytes as u32)
        .field("out-of-time", stats.out_of_time)
        .field("milliseconds", stats.milliseconds)
        .build();
    if let Some(reference) = stats.reference {
        figures.set("reference", reference);
    }
    if let Some(known) = &stats.known {
        figures.set("position-deviation", known.position);
        figures.set("rotation-deviation", known.rotation);
    }
    figures
}
