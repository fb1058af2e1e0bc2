//! The read-only property `stats`, a structure.

use gst::glib;
use gst::prelude::*;

pub const NAME: &str = "stats";

/// An element's properties, and `stats` behind them.
pub fn with_stats(own: &[glib::ParamSpec]) -> Vec<glib::ParamSpec> {
    let stats = glib::ParamSpecBoxed::builder::<gst::Structure>(NAME)
        .nick("Statistics")
        .blurb("Counts since the start, and figures of the last picture")
        .read_only()
        .build();
    own.iter().cloned().chain([stats]).collect()
}

/// Posts a frame's figures as an element message.
pub fn post(element: &gst::Element, figures: gst::Structure) {
    let message = gst::message::Element::builder(figures).src(element).build();
    // Without a bus nobody listens.
    let _ = element.post_message(message);
}

/// The functions of `ObjectImpl` about properties: those of the derive macro, which knows no structures, and `stats`.
macro_rules! properties_with_stats {
    () => {
        fn properties() -> &'static [glib::ParamSpec] {
            static ALL: std::sync::OnceLock<Vec<glib::ParamSpec>> = std::sync::OnceLock::new();
            ALL.get_or_init(|| crate::stats::with_stats(Self::derived_properties()))
        }

        fn set_property(&self, id: usize, value: &glib::Value, spec: &glib::ParamSpec) {
            self.derived_set_property(id, value, spec);
        }

        fn property(&self, id: usize, spec: &glib::ParamSpec) -> glib::Value {
            match spec.name() {
                crate::stats::NAME => self.stats().to_value(),
                _ => self.derived_property(id, spec),
            }
        }
    };
}
pub(crate) use properties_with_stats;
