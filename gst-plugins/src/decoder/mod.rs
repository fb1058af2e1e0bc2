//! `nvspdec`: packets to pictures.

mod element;

crate::element::class!("nvspdec", Decoder extends gst_video::VideoDecoder, gst::Element, gst::Object);
