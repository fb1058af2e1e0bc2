//! The residual: what the camera saw and the render did not, as a coded difference picture.
//!
//! It is always taken against the 8-bit picture that the decoder will render, and its quality is
//! always measured on the 8-bit picture that the decoder will show.

mod difference;
#[allow(unsafe_code)] // It wraps a C codec; each block says why it is sound.
mod libwebp;
mod rate;
mod webp;

use crate::Picture;
use crate::packet::{Residual, ResidualStart};

pub use difference::{add, difference};
pub use rate::{CodedResidual, Rate, ResidualEncoder};
pub use webp::Webp;

/// Why a residual cannot be coded or decoded.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ResidualError {
    /// A picture has not the size that it must have.
    #[error("picture of {}×{} where {}×{} is due", found.0, found.1, expected.0, expected.1)]
    Size {
        /// Width and height due, pixels.
        expected: (u32, u32),
        /// Width and height found.
        found: (u32, u32),
    },
    /// A picture's bytes are not as many as its size asks for.
    #[error("picture of {width}×{height} with {bytes} bytes")]
    Shape {
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
        /// Bytes it has.
        bytes: usize,
    },
    /// A quality is outside 0 to 100, or a PSNR not a number.
    #[error("rate {0:?}: quality must lie in 0..=100, PSNR be a number")]
    Rate(Rate),
    /// The image encoder refuses the difference picture.
    #[error("WebP encoder: {0}")]
    Encode(String),
    /// The payload is no picture of the expected kind.
    #[error("residual payload: {0}")]
    Payload(&'static str),
}

/// Longest payload of a difference picture of a size: libwebp's on noise at quality 100, with room
/// (see the tests of `webp`).
pub fn max_payload_len(width: u32, height: u32) -> usize {
    3 * (width as usize).next_multiple_of(16) * (height as usize).next_multiple_of(16) + 1024
}

/// Adds residuals to renders of one size, in memory of its own.
pub struct ResidualDecoder {
    webp: Webp,
    difference: Picture,
}

impl ResidualDecoder {
    /// For pictures of a size.
    pub fn new(width: u32, height: u32) -> ResidualDecoder {
        ResidualDecoder { webp: Webp::new(width, height), difference: Picture::new(width, height) }
    }

    /// Turns a render into the picture that a residual makes of it; nothing is changed on an error.
    ///
    /// # Errors
    /// If the payload is no picture of the render's size.
    pub fn add(&mut self, residual: &Residual, render: &mut Picture) -> Result<(), ResidualError> {
        if let Residual::Coded { coder, payload } = residual {
            check_size(&self.difference, render)?;
            self.webp.decode(*coder, payload, &mut self.difference)?;
            difference::add(&self.difference.data, &mut render.data);
        }
        Ok(())
    }

    /// As [`ResidualDecoder::add`], with the rows that the start of a payload holds; their number.
    pub fn add_start(
        &mut self,
        start: &ResidualStart,
        render: &mut Picture,
    ) -> Result<u32, ResidualError> {
        check_size(&self.difference, render)?;
        let rows = self.webp.decode_start(start, &mut self.difference)?;
        let bytes = rows * render.width as usize * 3;
        difference::add(&self.difference.data[..bytes], &mut render.data[..bytes]);
        Ok(rows as u32)
    }
}

/// Checks that a picture is whole and has the size of another.
fn check_size(of: &Picture, picture: &Picture) -> Result<(), ResidualError> {
    let (expected, found) = ((of.width, of.height), (picture.width, picture.height));
    if expected != found {
        return Err(ResidualError::Size { expected, found });
    }
    check_shape(picture)
}

fn check_shape(picture: &Picture) -> Result<(), ResidualError> {
    let Picture { width, height, ref data } = *picture;
    let bytes = data.len();
    if bytes > 0 && bytes == width as usize * height as usize * 3 {
        Ok(())
    } else {
        Err(ResidualError::Shape { width, height, bytes })
    }
}
