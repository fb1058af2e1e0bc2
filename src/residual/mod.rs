//! The residual: what the camera saw and the render did not, as a coded difference picture.
//!
//! It is always taken against the 8-bit picture that the decoder will render, and its quality is
//! always measured on the 8-bit picture that the decoder will show.

mod difference;
mod rate;
mod webp;

use crate::Picture;
use crate::packet::{Coder, Residual};

pub use difference::{apply, difference};
pub use rate::{CodedResidual, Rate, encode_residual};

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

/// The picture that a packet's residual makes of the render.
///
/// # Errors
/// Where the payload is no picture of the render's size. Nothing is allocated for one that is not.
pub fn decode_residual(render: &Picture, residual: &Residual) -> Result<Picture, ResidualError> {
    match residual {
        Residual::None | Residual::Omitted => Ok(render.clone()),
        Residual::Coded { coder, payload } => {
            check_shape(render)?;
            let difference = decode_difference(*coder, payload, render)?;
            Ok(apply(render, &difference))
        }
    }
}

fn decode_difference(
    coder: Coder,
    payload: &[u8],
    render: &Picture,
) -> Result<Picture, ResidualError> {
    match coder {
        Coder::Vp8 => webp::decode_vp8(payload, render.width, render.height),
        Coder::WebP => webp::decode_file(payload, render.width, render.height),
    }
}

fn check_shape(picture: &Picture) -> Result<(), ResidualError> {
    let Picture { width, height, ref data } = *picture;
    let bytes = data.len();
    if bytes == width as usize * height as usize * 3 {
        Ok(())
    } else {
        Err(ResidualError::Shape { width, height, bytes })
    }
}
