//! Why an image cannot be read or a picture cannot be written.

use super::pixel_format::PixelFormat;

/// Why an image cannot be read or a picture cannot be written.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs)] // Their texts tell.
pub enum PixelError {
    #[error("image size {width}×{height}: sides must lie in 1..={max}")]
    Size { width: u32, height: u32, max: u32 },
    #[error("plane {plane}: a stride of {found} bytes, but a row takes {needed}")]
    Stride { plane: &'static str, needed: usize, found: usize },
    #[error("plane {plane}: {found} bytes, but {needed} are due")]
    TooShort { plane: &'static str, needed: usize, found: usize },
    #[error("image of {}×{} is of another shape than the camera's {}×{}; scaling would distort it",
        found.0, found.1, expected.0, expected.1)]
    Shape { expected: (u32, u32), found: (u32, u32) },
    #[error("image of {}×{}, but the lens is for images of {}×{}", found.0, found.1, expected.0, expected.1)]
    LensSize { expected: (u32, u32), found: (u32, u32) },
    #[error("pictures are written as Rgb8, Bgr8 or Rgba8, not as {0:?}")]
    NotWritten(PixelFormat),
}
