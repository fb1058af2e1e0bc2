//! Pictures in the buffers of a pipeline.

use gst::prelude::*;
use gst_video::prelude::*;
use gst_video::{VideoFormat, VideoInfo};

use nvsprior::Decoded;
use nvsprior::image::{ImageView, PixelFormat, write_picture};

use crate::caps;

use super::truth::mark_regions;

/// The formats that pictures are written in.
const FORMATS: [(VideoFormat, PixelFormat); 4] = [
    (VideoFormat::Rgb, PixelFormat::Rgb8),
    (VideoFormat::Rgbx, PixelFormat::Rgba8),
    (VideoFormat::Rgba, PixelFormat::Rgba8),
    (VideoFormat::Bgr, PixelFormat::Bgr8),
];

/// What pictures may be.
pub fn caps() -> gst::Caps {
    caps::pictures(&FORMATS.map(|(format, _)| format), nvsprior::Camera::MAX_SIDE)
}

/// The format that is agreed on with those downstream.
pub fn choose_format(pad: &gst::Pad) -> Result<(VideoFormat, PixelFormat), gst::FlowError> {
    let mut wanted = pad.allowed_caps().unwrap_or_else(|| pad.pad_template_caps());
    if wanted.is_empty() {
        return Err(gst::FlowError::NotNegotiated);
    }
    wanted.fixate();
    let name = wanted.structure(0).and_then(|fields| fields.get::<String>("format").ok());
    let format = name.map_or(VideoFormat::Rgb, |name| VideoFormat::from_string(&name));
    let written = FORMATS.iter().find(|(of, _)| *of == format);
    written.copied().ok_or(gst::FlowError::NotNegotiated)
}

/// Writes a picture and what is known of its parts to a buffer.
pub fn write(
    decoded: &Decoded,
    has_overlay: bool,
    (info, format): (&VideoInfo, PixelFormat),
    buffer: &mut gst::BufferRef,
) -> Result<(), gst::ErrorMessage> {
    let failed = |error: &dyn std::fmt::Display| {
        gst::error_msg!(gst::StreamError::Decode, ("writing a picture: {error}"))
    };
    mark_regions(decoded, buffer);
    let drawn_over = has_overlay.then(|| {
        let mut picture = decoded.picture.clone();
        decoded.truth.draw_over(&mut picture);
        picture
    });
    let picture = drawn_over.as_ref().unwrap_or(&decoded.picture);
    let mut mapped = gst_video::VideoFrameRef::from_buffer_ref_writable(buffer, info)
        .map_err(|error| failed(&error))?;
    let stride = mapped.plane_stride().first().map_or(0, |stride| (*stride).max(0) as usize);
    let plane = mapped.plane_data_mut(0).map_err(|error| failed(&error))?;
    write_picture(picture, format, stride, plane).map_err(|error| failed(&error))
}

// Sizes that packets can state are sizes that images can have.
const _: () = assert!(nvsprior::Camera::MAX_SIDE <= ImageView::MAX_SIDE);
