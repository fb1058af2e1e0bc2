//! What the elements that show pictures share.

mod pictures;
mod properties;
mod regions;
mod truth;

pub use pictures::{caps, choose_format, write};
pub use properties::Showing;
pub(crate) use properties::showing_element;
pub use truth::truth;

use nvsprior::{Decoded, Error};

/// The figures of a picture, for a message of this name.
pub fn figures(
    name: &str,
    decoded: &Decoded,
    bytes: usize,
    taken: gst::ClockTime,
) -> gst::Structure {
    let mut figures = gst::Structure::builder(name)
        .field("frame", decoded.frame)
        .field("bytes", bytes as u32)
        .field("certain", !decoded.uncertain)
        .field("kept", decoded.kept)
        .field("portable", decoded.portable)
        .field("filtered", decoded.filtered)
        .field("milliseconds", taken.mseconds() as f64)
        .build();
    if let Some(reference) = decoded.reference {
        figures.set("reference", reference);
    }
    if let Some(known) = &decoded.known {
        figures.set("position-deviation", known.position);
        figures.set("rotation-deviation", known.rotation);
    }
    if let Some(same) = decoded.same_render {
        figures.set("same-render", same);
    }
    if let Some(damage) = &decoded.damage {
        figures.set("damage", damage.to_string());
    }
    figures
}

/// Latency is told in steps of this, and up to the most.
const LATENCY_STEP: gst::ClockTime = gst::ClockTime::from_mseconds(20);
const MAX_LATENCY: gst::ClockTime = gst::ClockTime::from_seconds(1);

/// What a picture took, as it is told downstream: sinks wait for so long.
pub fn latency_of(taken: gst::ClockTime) -> gst::ClockTime {
    let steps = taken.nseconds().div_ceil(LATENCY_STEP.nseconds());
    (LATENCY_STEP * steps).min(MAX_LATENCY)
}

/// What was wrong with the packet before, so that it is not said again and again.
#[derive(Default)]
pub struct Complaint(Option<std::mem::Discriminant<Error>>);

impl Complaint {
    /// Whether this is to be said. Frame numbers change from packet to packet.
    pub fn is_new(&mut self, wrong: Option<&Error>) -> bool {
        let kind = wrong.map(std::mem::discriminant);
        std::mem::replace(&mut self.0, kind) != kind && kind.is_some()
    }
}
