//! `nvsptopside`: modem frames to pictures, and reports out.

mod element;
mod end;

crate::element::class!("nvsptopside", TopsideEnd extends gst::Element, gst::Object);
