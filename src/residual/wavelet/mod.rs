//! The wavelet coder: a coder of difference pictures that knows the render.
//!
//! The difference between camera picture and render is rotated to three planes (`colour`), divided into bands by a
//! 9/7 wavelet of up to six levels (`lifting`), and quantised with one step for all bands of unit norm (`step`). Where
//! the render's details are of no use, small blocks leave them out of the prediction (`small_blocks`). Coefficients are
//! coded from coarse to fine (`pass`) by a binary range coder (`src/range_coder.rs`). A small network (`network`)
//! gives each bit's chance. It looks at coefficients coded before, at the decoded coarser picture, and at the
//! render's own bands (`context`). All of it is integers: encoder and decoder agree on every processor.

mod adaptive_bit;
mod bits;
mod block_cost;
#[cfg(feature = "encode")]
mod budget;
mod choose;
mod coarser;
pub(super) mod colour;
mod context;
mod decoder;
mod displaced;
mod displaced_choice;
mod encoder;
mod fineness;
mod fixed;
mod frame;
mod gains;
mod geometry;
mod header;
mod inter;
mod lifting;
mod model;
mod pass;
mod predictor;
mod prices;
mod quantised;
#[cfg(feature = "encode")]
mod rate;
mod render;
mod render_value;
mod small_blocks;
mod small_blocks_choice;
mod step;
pub(super) mod sub_pixel;
#[cfg(feature = "encode")]
pub mod training;
mod weights;

pub use decoder::{Payload, WaveletDecoder};
pub use displaced::Earlier;
pub use encoder::WaveletEncoder;
pub use geometry::Planes;
#[cfg(feature = "encode")]
pub(super) use rate::{FrameKind, RateEncoder};
pub use step::{STEPS, Step};
