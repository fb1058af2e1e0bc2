//! `nvspdec`: packets to pictures.

mod element;

use gst::glib;
use gst::prelude::*;

glib::wrapper! {
    pub struct Decoder(ObjectSubclass<element::Decoder>)
        @extends gst_video::VideoDecoder, gst::Element, gst::Object;
}

pub fn register(plugin: &gst::Plugin) -> Result<(), glib::BoolError> {
    // No rank: it cannot be chosen by itself, as it needs a prior.
    gst::Element::register(Some(plugin), "nvspdec", gst::Rank::NONE, Decoder::static_type())
}
