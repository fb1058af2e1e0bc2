//! Why a residual cannot be coded or decoded.

use super::Rate;

/// Why a residual cannot be coded or decoded.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Their texts tell.
pub enum ResidualError {
    #[error("picture of {}×{}, but {}×{} is due", found.0, found.1, expected.0, expected.1)]
    Size { expected: (u32, u32), found: (u32, u32) },
    #[error("picture of {width}×{height} with {bytes} bytes")]
    Shape { width: u32, height: u32, bytes: usize },
    #[error("rate {0:?}: quality must lie in 0..=100, PSNR be a number")]
    Rate(Rate),
    #[error(
        "map of interest of {columns}×{rows} cells with {weights} weights: give one for each, and 1 to 4096 along a \
            side"
    )]
    InterestSize { columns: u32, rows: u32, weights: usize },
    #[error("map of interest: the weight of cell {cell} is 0; the least is 1")]
    InterestWeight { cell: usize },
    #[error("rectangle of interest: no pixel of the picture lies in it")]
    InterestEmpty,
    #[error(
        "residual payload: it needs the encoder's render, but one of the two devices is not portable"
    )]
    OtherRender,
    #[error(
        "frame {frame}: its residual is predicted from that of frame {reference}, which is missing, came in part, or \
         is of another stream"
    )]
    ReferenceMissing { frame: u32, reference: u32 },
    #[error("{found} depths, but {expected} are due")]
    Depths { expected: usize, found: usize },
    #[error("residual payload: {0}")]
    Payload(&'static str),
}
