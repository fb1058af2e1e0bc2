//! The command line, as scripts use it: arguments, files, exit codes.

mod bench;
mod decode;
mod dive;
mod encode;
mod inputs;
mod refusals;
mod render;
#[path = "../scene/mod.rs"]
mod scene;
