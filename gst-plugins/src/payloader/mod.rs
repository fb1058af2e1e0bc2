//! `nvsppay`: packets to shares.

mod element;
mod pieces;

crate::element::class!("nvsppay", Payloader extends gst::Element, gst::Object);
