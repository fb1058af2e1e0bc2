//! The demo's job: two inspection runs of the basin, encoded, decoded in another process, and compared.

// Not published: names that tell what they are need no comment.
#![allow(missing_docs)]

#[macro_use]
extern crate nvsprior_runs;

mod coding;
mod job;
pub mod prior;
mod table;
pub mod topside;
mod webp;

pub use job::{Job, draw_dive, run};
