//! The container of our own files: a head, then parts, each with a name, its length and a check.
//!
//! The bytes: `docs/format/prior.md`. Compact and blocked priors, and the file beside a foreign prior, share it.

mod covered;
mod extras;
mod file;
mod frame;
mod head;
mod key_frames;
mod lens;
mod options;
mod part;
mod pose_trials;
mod preprocessing;
mod tables;
mod words;

pub use covered::{Covered, covered_parts};
pub use file::Container;
pub use head::{Format, Head};
pub use part::PartName;
pub use words::Words;

#[cfg(test)]
mod tests;
