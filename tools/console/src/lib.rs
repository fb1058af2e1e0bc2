//! A working link, in three programs. `nvsprior vehicle` turns frames into modem frames. `nvsprior channel` carries
//! them as an acoustic link would. `nvsprior console` shows the pilot what comes.

// Not published: names that tell what they are need no comment.
#![allow(missing_docs)]

#[macro_use]
extern crate nvsprior_inputs;

pub mod channel;
pub mod console;
mod endpoint;
mod journal;
mod state_file;
pub mod vehicle;

#[cfg(test)]
#[path = "../../../tests/common/mod.rs"]
mod common;
#[cfg(test)]
#[path = "../../../tests/scene/mod.rs"]
mod scene;
