//! An emulator: runs a SPIR-V compute module on the host, one invocation after another, with subgroups of any size.
//! So the very modules that ship can be tested for subgroups that no device at hand has.
//!
//! It checks what a device does not: every access is within bounds, every word of shared memory is written before it is
//! read, no two invocations race for a word, and all lanes of a subgroup meet at the same operation. Subgroups of up
//! to 16 must all pass as many barriers of their own, as some drivers make each one of the workgroup. The order of
//! invocations, and which of them are a subgroup, are drawn from a seed.
//!
//! The memory model is Vulkan's. So an access to memory that invocations share must say that it is not private, and a
//! barrier orders such accesses only if it makes them visible.
//!
//! It knows what the modules of this project use: one function, 32-bit numbers, the GLSL450 operations that occur.
//! Anything else is an [`Error`].

mod decode;
mod error;
mod layout;
mod memory;
mod ops;
mod program;
mod races;
mod run;
mod subgroups;
mod turn;
mod values;

pub use decode::without_barrier;
pub use error::{Error, Place};
pub use program::Module;
pub use run::{Counts, Dispatch};
