//! What flows between the elements.

/// Packets: one buffer is one packet.
///
/// Fields, all optional: `framerate` of the camera; `width` and `height` of the pictures; `prior`, the identity of the
/// prior in hexadecimal; `trust`, `start` if a packet may end early and all bytes before its end are valid.
pub const PACKET: &str = "video/x-nvsprior";

/// Modem frames: one buffer is one modem frame or datagram.
///
/// Fields, all optional: `framerate` of the camera; `stream`, 0 to 3.
pub const SHARE: &str = "application/x-nvsprior-share";

/// Reports: one buffer is one report of the topside.
pub const REPORT: &str = "application/x-nvsprior-report";

/// What a frame takes to be coded, if no caps state a frame rate.
pub const UNKNOWN_FRAME_TIME: gst::ClockTime = gst::ClockTime::from_mseconds(100);

pub fn any(name: &str) -> gst::Caps {
    gst::Caps::new_empty_simple(name)
}

/// Pictures of these formats, with sides of at most `max_side` pixels.
pub fn pictures(formats: &[gst_video::VideoFormat], max_side: u32) -> gst::Caps {
    let side = 1..=max_side as i32;
    gst_video::VideoCapsBuilder::new()
        .format_list(formats.iter().copied())
        .width_range(side.clone())
        .height_range(side)
        .build()
}

/// The camera's frame rate that caps state, frames per second; `None`: they state none.
pub fn frame_rate(caps: &gst::CapsRef) -> Option<gst::Fraction> {
    let rate = caps.structure(0)?.get::<gst::Fraction>("framerate").ok()?;
    (rate.numer() > 0 && rate.denom() > 0).then_some(rate)
}

pub fn per_second(rate: gst::Fraction) -> f64 {
    f64::from(rate.numer()) / f64::from(rate.denom())
}
