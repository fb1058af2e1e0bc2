//! The GPU stages of nvsprior, in Rust by rust-gpu: a file per stage, each named as the host file
//! that dispatches it (`src/render/`, `src/refine/`) and as its f64 twin (`src/reference/`).
#![no_std]
#![cfg_attr(target_arch = "spirv", feature(asm_experimental_arch))]

pub mod search;
pub mod shared;

pub mod bin;
pub mod ceilings;
pub mod derive;
pub mod finish;
pub mod lanes;
pub mod list;
pub mod memory;
pub mod place;
pub mod project;
pub mod pyramid;
pub mod radix;
pub mod reduce;
pub mod solve;
pub mod splat;
pub mod splat_exact;
pub mod splat_flow;
