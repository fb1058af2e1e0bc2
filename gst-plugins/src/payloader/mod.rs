//! `nvsppay`: packets to shares.

mod element;

use gst::glib;
use gst::prelude::*;

glib::wrapper! {
    pub struct Payloader(ObjectSubclass<element::Payloader>) @extends gst::Element, gst::Object;
}

pub fn register(plugin: &gst::Plugin) -> Result<(), glib::BoolError> {
    gst::Element::register(Some(plugin), "nvsppay", gst::Rank::NONE, Payloader::static_type())
}
