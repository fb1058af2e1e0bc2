//! Measures the engine: run time and error ([`mod@bench`]), numbers at their extremes ([`stability`]), what a device
//! can do at best ([`ceilings`]), how much of that each stage should take ([`cost`]), all that of one device
//! ([`device_report`]), and what a GPU's compiler makes of the stages ([`gpu_check`]). Beside them the paper's system
//! ([`paper`]), and the scenes to measure on ([`draw`]).

// Not published: names that tell what they are need no comment.
#![allow(missing_docs)]

#[macro_use]
extern crate nvsprior_inputs;

mod args;
pub mod bench;
pub mod ceilings;
pub mod cost;
pub mod device_report;
pub mod draw;
pub mod gpu_check;
pub mod paper;
pub mod stability;
