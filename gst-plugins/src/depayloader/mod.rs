//! `nvspdepay`: shares to packets.

mod element;

use gst::glib;
use gst::prelude::*;

glib::wrapper! {
    pub struct Depayloader(ObjectSubclass<element::Depayloader>) @extends gst::Element, gst::Object;
}

pub fn register(plugin: &gst::Plugin) -> Result<(), glib::BoolError> {
    gst::Element::register(Some(plugin), "nvspdepay", gst::Rank::NONE, Depayloader::static_type())
}
