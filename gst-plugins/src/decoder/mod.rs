//! `nvspdec`: packets to pictures.

mod element;
mod regions;

crate::element::class!("nvspdec", Decoder extends gst_video::VideoDecoder, gst::Element, gst::Object);
