//! What the GPU stages of nvsprior share with the host: constants, buffer layouts and maths ([`shared`]), arithmetic
//! with the same bits on every device ([`portable`]), the search for a pose ([`search`]), layouts of training
//! ([`training`]), layers of the display filter ([`filter`]), tables of counters ([`block_table`]), and the built
//! SPIR-V ([`modules`]).
//!
//! The stages use this crate on the device, the library `nvsprior` uses it on the host. So both agree on every layout,
//! and the library needs no shader compiler.

#![no_std]

// On the host `std` has the functions of `f32`; on the device `spirv_std` has them.
#[cfg(not(target_arch = "spirv"))]
extern crate std;

pub mod block_table;
pub mod filter;
#[cfg(not(target_arch = "spirv"))]
pub mod modules;
pub mod portable;
pub mod search;
pub mod shared;
pub mod training;
