//! An update of a prior, `.nvsu`: what a vehicle learns on a dive, as a file of about seven bytes per splat.
//!
//! Updates form a chain. Each one names the prior, its number and the state that it stands on; [`Learnt`] adds them up.
//! An update adds splats, takes back splats of updates before, and fades the prior's own splats in boxes.
//!
//! | byte | type | content |
//! |---|---|---|
//! | 0 | | `nvsu` |
//! | 4 | u8 | version of the format: 1 |
//! | 5 | u32 | [`PriorId`](super::PriorId) of the prior that the chain begins with |
//! | 9 | u16 | number in the chain, from 1 on |
//! | 11 | u32 | [`StateId`] that it stands on; for number 1 the prior's identity |
//! | 15 | | the coded part |
//! | end − 4 | u32 | CRC-32 of all bytes before |
//!
//! All little endian.

mod attributes;
mod bits;
mod body;
mod content;
mod error;
mod fade;
mod fade_box;
mod file;
mod format;
mod grid;
mod learnt;
mod limits;
mod merge;
mod places;
mod splat;
mod state;

pub use content::Update;
pub use error::UpdateError;
pub use fade::Fade;
pub use format::MAGIC;
pub use grid::UpdateGrid;
pub use learnt::Learnt;
pub(crate) use merge::append;
pub use limits::*;
pub use splat::{LearntSplat, NewSplat};
pub use state::StateId;

#[cfg(test)]
pub(crate) mod tests;
