//! An update of a prior, `.nvsu`: what a vehicle learns on a dive, as a file of about seven bytes per splat.
//!
//! Updates form a chain. Each one names the prior, its number and the state that it stands on; [`Learnt`] adds them up,
//! and [`UpdateChain`] keeps them in one file.
//! An update adds splats, changes or takes back splats of updates before, and fades the prior's own splats in boxes.
//!
//! The bytes, the coded part number by number, and what an update adds up to: `docs/format/update.md`.
//!
//! **Order.** Splats come in the order of the tree, that of the Morton curve; those at one place keep theirs. Learnt
//! splats are numbered in the order in which the updates brought them.
//!
//! **Rotations.** A splat looks the same after any of 24 renamings of its axes, and after any turn about an axis across
//! which it is round. [`NewSplat::nearest`] takes the smallest rotation of all these. A splat with three equal scales
//! has none in the file.
//!
//! **Changes.** A splat that changes keeps its place among the learnt ones, the names of its axes, and the grid that it
//! came with. `removed` and `changed` name places before the update. No splat is in both.
//!
//! **State.** [`Update::state`] hashes the values, not the bytes: `content.rs` says in which order. If both sides of a
//! link agree on the state, they hold the same splats and fades, to the last bit.
//!
//! **Same on every machine.** Reading uses only additions, products, quotients and square roots of f64, each rounded to
//! f32 once. An update has one form: what [`Update::write`] would write in another way is refused.
//!
//! **What it costs.** Bytes per new splat, on the sides of boxes of 200 × 120 × 80 and 400 × 60 × 60 steps, turned
//! anyhow: scales of exp(−3 ± 0.7), all rotations, three colours ± 0.15. Means of 16 boxes each, by
//! `attributes/figures.rs`:
//!
//! | splats | position | scales | rotation | opacity | colour | besides, bytes | file, bytes | file, per splat |
//! |---|---|---|---|---|---|---|---|---|
//! | 60 | 2.39 | 1.32 | 1.10 | 0.39 | 1.37 | 38 | 432 | 7.21 |
//! | 150 | 2.12 | 1.31 | 1.07 | 0.39 | 1.30 | 39 | 968 | 6.45 |
//! | 400 | 1.87 | 1.29 | 1.05 | 0.38 | 1.25 | 39 | 2377 | 5.94 |
//!
//! What else was tried on such boxes, bytes per splat for 60, 150 and 400 of them:
//!
//! | part | way | 60 | 150 | 400 |
//! |---|---|---|---|---|
//! | position | distances along the Morton curve | 2.56 | 2.21 | 1.92 |
//! | colour | less the mean of all before | 1.69 | 1.55 | 1.50 |
//! | colour | less that of the splat before | 1.86 | 1.72 | 1.64 |
//! | colour | less that of the nearest of all before | 1.80 | 1.67 | 1.60 |
//! | scales | all three less the mean of all before | 1.39 | 1.37 | 1.36 |
//! | scales | as a tree of six bits | 1.43 | 1.36 | 1.32 |
//! | rotation | as a tree of four bits | 1.24 | 1.20 | 1.19 |
//!
//! (The rotation took 1.21, 1.19 and 1.18 bytes there, since turns that show nothing were still in it.) Chances that
//! follow the last 15 bits, in place of 120, take up to 0.02 bytes more for each part. Those that follow the last 250
//! take the same within 0.003 bytes. Chances that know nothing at first take 0.07 bytes more for 60 splats.
//!
//! A change takes 4.3 bytes: the mean of 3,024 changes that a learner made on a dive of the demo. That is for its place
//! 0.14, the position 1.37, the scales 0.73, the rotation 0.88, the opacity 0.22, the colour 0.97. Of these numbers 15
//! % (position) to 52 % (opacity) are zero. Other contexts, and colours as differences from green, take within 0.05
//! bytes of that: the numbers hardly depend on each other. A splat that is taken back and sent anew takes about 6.5
//! bytes.

mod attributes;
mod body;
mod chain;
mod change;
mod changes;
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

pub use chain::{CHAIN_MAGIC, ChainRead, DIVE_FILE, UpdateChain};
pub use change::Change;
pub use content::Update;
pub use error::UpdateError;
pub use fade::Fade;
pub use format::MAGIC;
pub use grid::UpdateGrid;
pub use learnt::Learnt;
pub use limits::*;
pub(crate) use merge::append;
pub use splat::{LearntSplat, NewSplat};
pub use state::StateId;

#[cfg(test)]
pub(crate) mod tests;
