//! The command line, as scripts use it: arguments, files, exit codes.

mod ablation;
mod bench;
mod blocks;
mod codecs;
#[path = "../../../../tests/common/mod.rs"]
mod common;
mod console;
mod decode;
mod demo_prior;
mod device_report;
mod dive;
mod encode;
mod filter;
mod inputs;
mod key;
mod key_frames;
mod learn;
mod link;
mod map;
mod map_hard;
mod map_parts;
#[cfg(unix)]
mod map_structure;
mod merge;
mod paper;
mod preprocessing;
mod recovery;
mod refusals;
mod render;
#[path = "../../../../tests/scene/mod.rs"]
mod scene;
mod stability;
mod study;
mod tables;
#[cfg(unix)]
mod video;
