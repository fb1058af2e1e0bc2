//! `nvspenc`: frames to packets.

mod element;
mod frames;
mod settings;

crate::element::class!(
    "nvspenc",
    Encoder extends gst_video::VideoEncoder, gst::Element, gst::Object; implements gst::Preset
);
