//! The command line, as scripts use it: arguments, files, exit codes.

mod blocks;
#[path = "../../../../tests/common/mod.rs"]
mod common;
#[cfg(feature = "console")]
mod console;
mod decode;
mod demo_prior;
mod derived;
mod dive;
mod encode;
mod far;
mod filter;
mod folders;
mod inputs;
mod key;
mod key_frames;
mod link;
mod map;
mod preprocessing;
mod refusals;
mod render;
#[path = "../../../../tests/scene/mod.rs"]
mod scene;
mod size;
mod study;
mod tables;
mod treated;
#[cfg(unix)]
mod video;
