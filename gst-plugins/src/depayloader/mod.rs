//! `nvspdepay`: shares to packets.

mod element;

crate::element::class!("nvspdepay", Depayloader extends gst::Element, gst::Object);
