//! The GPU stages of nvsprior, in Rust by rust-gpu: a file per stage, each named as the host file
//! that dispatches it (`src/render/`, `src/refine/`) and as its f64 twin (`src/reference/`).
#![no_std]

pub mod shared;

pub mod bin;
pub mod derive;
pub mod lanes;
pub mod memory;
pub mod project;
pub mod radix;
pub mod reduce;
pub mod splat;
pub mod splat_exact;
pub mod splat_flow;
