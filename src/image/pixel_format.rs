//! How the bytes of images are laid out.

/// How the bytes of an image are laid out.
///
/// The chroma planes of NV12 and I420 have half the sides of the image, rounded up. A chroma sample
/// lies in the middle of its four pixels, as in V4L2's drawings of these formats, JPEG and MPEG-1.
/// If an H.264 stream has it half a pixel further left, colours shift by that much.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PixelFormat {
    /// One plane; red, green, blue.
    #[default]
    Rgb8,
    /// One plane; blue, green, red.
    Bgr8,
    /// One plane; red, green, blue and a byte that is ignored.
    Rgba8,
    /// Two planes; Y, then U and V in turns (4:2:0).
    Nv12,
    /// Three planes; Y, U, V (4:2:0).
    I420,
}
