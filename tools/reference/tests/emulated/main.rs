//! Runs the modules that ship by the emulator, with subgroups of 16, 32 and 64, and holds what they leave against the
//! twins and the definition of the picture. The emulator checks bounds, races and barriers on the way.

#[path = "../compare_gpu_cpu/agreement.rs"]
mod agreement;
#[path = "../../../../tests/common/mod.rs"]
mod common;
#[path = "../compare_gpu_cpu/difference.rs"]
#[allow(dead_code)] // Pictures of the device are drawn elsewhere.
mod difference;

mod barriers;
mod chain;
mod lists;
mod others;
mod pictures;
mod sort;
mod sums;
