//! The GPU stages of nvsprior, in Rust by rust-gpu. Passes of one algorithm (`radix`, `bin`) share a file; every
//! other stage has its own. The f64 twins in `tools/reference` have the same names.
#![no_std]
#![cfg_attr(target_arch = "spirv", feature(asm_experimental_arch))]

pub use nvsprior_kernels::{block_table, filter, portable, search, shared, training};

pub mod arithmetic;
pub mod bin;
pub mod blend;
pub mod ceilings;
pub mod counters;
pub mod filter_layer;
pub mod lanes;
pub mod list;
pub mod memory;
pub mod pose_jacobian;
pub mod project;
pub mod pyramid;
pub mod quantize_rgb8;
pub mod radix;
pub mod radix_waves;
pub mod reduce;
pub mod rows;
pub mod solve;
pub mod splat;
pub mod splat_backward;
pub mod splat_exact;
pub mod splat_flow;
pub mod splat_gradient;
pub mod ssim;
pub mod train_activate;
pub mod train_gradient;
pub mod train_slots;
pub mod train_step;
