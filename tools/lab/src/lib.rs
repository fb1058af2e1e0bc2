//! Measures the engine: run time and error ([`mod@bench`]), numbers at their extremes ([`stability`]), whether a device
//! is portable ([`verify_device`]), what a device can do at best ([`ceilings`]), how much of that each stage should
//! take ([`cost`]), all that of one device ([`device_report`]), what a GPU's compiler makes of the stages
//! ([`gpu_check`]), and what a pilot sees over a link ([`mod@link`]).

// Not published: names that tell what they are need no comment.
#![allow(missing_docs)]

#[macro_use]
extern crate nvsprior_inputs;

pub mod bench;
pub mod ceilings;
pub mod cost;
pub mod device_report;
mod ffmpeg;
pub mod gpu_check;
pub mod link;
pub mod report;
pub mod stability;
pub mod verify_device;
