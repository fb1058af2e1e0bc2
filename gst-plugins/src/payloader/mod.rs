//! `nvsppay`: packets to shares.

mod element;

crate::element::class!("nvsppay", Payloader extends gst::Element, gst::Object);
