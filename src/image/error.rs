//! Why an image cannot be read or a picture cannot be written.

use super::pixel_format::PixelFormat;

/// Why an image cannot be read or a picture cannot be written.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PixelError {
    /// A side is zero or too long.
    #[error("image size {width}×{height}: sides must lie in 1..={max}")]
    Size {
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
        /// Longest side.
        max: u32,
    },
    /// The rows of a plane would overlap.
    #[error("plane {plane}: a stride of {found} bytes, but a row takes {needed}")]
    Stride {
        /// The plane.
        plane: &'static str,
        /// Bytes of a row.
        needed: usize,
        /// The stride.
        found: usize,
    },
    /// The bytes of a plane end before its rows do.
    #[error("plane {plane}: {found} bytes, but {needed} are due")]
    TooShort {
        /// The plane.
        plane: &'static str,
        /// Bytes up to the end of the last row, at most `usize::MAX`.
        needed: usize,
        /// Bytes that are there.
        found: usize,
    },
    /// The ratio of an image's sides is not the camera's.
    #[error("image of {}×{} is of another shape than the camera's {}×{}; scaling would distort it",
        found.0, found.1, expected.0, expected.1)]
    Shape {
        /// The camera's width and height.
        expected: (u32, u32),
        /// The image's.
        found: (u32, u32),
    },
    /// An image has another size than its lens is for.
    #[error("image of {}×{}, but the lens is for images of {}×{}", found.0, found.1, expected.0, expected.1)]
    LensSize {
        /// Width and height that the lens states.
        expected: (u32, u32),
        /// The image's.
        found: (u32, u32),
    },
    /// Pictures are not written in this format.
    #[error("pictures are written as Rgb8, Bgr8 or Rgba8, not as {0:?}")]
    NotWritten(PixelFormat),
}
