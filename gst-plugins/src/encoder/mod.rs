//! `nvspenc`: frames to packets.

mod element;
mod frames;
mod settings;

use gst::glib;
use gst::prelude::*;

glib::wrapper! {
    pub struct Encoder(ObjectSubclass<element::Encoder>)
        @extends gst_video::VideoEncoder, gst::Element, gst::Object,
        @implements gst::Preset;
}

pub fn register(plugin: &gst::Plugin) -> Result<(), glib::BoolError> {
    gst::Element::register(Some(plugin), "nvspenc", gst::Rank::NONE, Encoder::static_type())
}
