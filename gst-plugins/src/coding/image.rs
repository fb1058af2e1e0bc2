//! A frame of a pipeline as the library takes it.

use gst_video::prelude::*;
use gst_video::{VideoColorMatrix, VideoColorRange, VideoFormat};
use nvsprior::image::{Colour, ImageView, PixelFormat};

/// What frames may be.
pub const FORMATS: [VideoFormat; 6] = [
    VideoFormat::Rgb,
    VideoFormat::Nv12,
    VideoFormat::I420,
    VideoFormat::Bgr,
    VideoFormat::Rgba,
    VideoFormat::Rgbx,
];

/// The frame's image, for the library.
pub fn view<'a>(
    frame: &'a gst_video::VideoFrameRef<&gst::BufferRef>,
) -> Result<ImageView<'a>, gst::ErrorMessage> {
    let info = frame.info();
    let format = match info.format() {
        VideoFormat::Rgb => PixelFormat::Rgb8,
        VideoFormat::Bgr => PixelFormat::Bgr8,
        VideoFormat::Rgba | VideoFormat::Rgbx => PixelFormat::Rgba8,
        VideoFormat::Nv12 => PixelFormat::Nv12,
        VideoFormat::I420 => PixelFormat::I420,
        other => {
            let text = format!("frames of the format {other:?}");
            return Err(gst::error_msg!(gst::StreamError::Format, ("{text}")));
        }
    };
    let colorimetry = info.colorimetry();
    let full = colorimetry.range() == VideoColorRange::Range0_255;
    let colour = match (colorimetry.matrix(), full) {
        (VideoColorMatrix::Bt709, false) => Colour::Bt709Limited,
        (VideoColorMatrix::Bt709, true) => Colour::Bt709Full,
        (_, false) => Colour::Bt601Limited,
        (_, true) => Colour::Bt601Full,
    };
    let planes = frame.planes_data();
    let stride = |plane: usize| {
        frame.plane_stride().get(plane).map_or(0, |stride| (*stride).max(0) as usize)
    };
    Ok(ImageView {
        width: info.width(),
        height: info.height(),
        format,
        colour,
        planes: [planes[0], planes[1], planes[2]],
        strides: [stride(0), stride(1), stride(2)],
    })
}
