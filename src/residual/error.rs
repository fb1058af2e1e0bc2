//! Why a residual cannot be coded or decoded.

use super::Rate;

/// Why a residual cannot be coded or decoded.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ResidualError {
    /// A picture has not the size that it must have.
    #[error("picture of {}×{}, but {}×{} is due", found.0, found.1, expected.0, expected.1)]
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
    /// A map of interest has no cells, too many, or not as many weights as cells.
    #[error(
        "map of interest of {columns}×{rows} cells with {weights} weights: give one for each, and 1 to 4096 along a \
            side"
    )]
    InterestSize {
        /// Cells in a row.
        columns: u32,
        /// Rows.
        rows: u32,
        /// Weights given.
        weights: usize,
    },
    /// A weight of a map of interest is 0.
    #[error("map of interest: the weight of cell {cell} is 0; the least is 1")]
    InterestWeight {
        /// The cell, row by row.
        cell: usize,
    },
    /// A rectangle of interest holds no pixel of the picture.
    #[error("rectangle of interest: no pixel of the picture lies in it")]
    InterestEmpty,
    /// libwebp refuses the difference picture.
    #[error("WebP encoder: {0}")]
    Encode(String),
    /// This library was built without the coder of the payload.
    #[error(
        "residual payload: coded by {coder}, which this library was built without (feature `{feature}`)"
    )]
    CoderMissing {
        /// The coder.
        coder: &'static str,
        /// The feature that brings it.
        feature: &'static str,
    },
    /// The payload can be read only beside the encoder's own render.
    #[error(
        "residual payload: it needs the encoder's render, but one of the two devices is not portable"
    )]
    OtherRender,
    /// The reference frame of a stream's residual is not there, or is not the one that the encoder had.
    #[error(
        "frame {frame}: its residual is predicted from that of frame {reference}, which is missing, came in part, or \
         is of another stream"
    )]
    ReferenceMissing {
        /// Number of the frame, modulo 2²⁴.
        frame: u32,
        /// Number of its reference.
        reference: u32,
    },
    /// There is not one depth for each pixel.
    #[error("{found} depths, but {expected} are due")]
    Depths {
        /// Pixels.
        expected: usize,
        /// Depths.
        found: usize,
    },
    /// The payload is no picture of the expected kind.
    #[error("residual payload: {0}")]
    Payload(&'static str),
}
