//! `nvspvehicle`: frames to modem frames, and reports in.

mod element;
mod settings;

crate::element::class!(
    "nvspvehicle",
    VehicleEnd extends gst::Element, gst::Object; implements gst::Preset
);
