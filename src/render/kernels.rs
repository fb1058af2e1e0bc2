//! The compute pipelines of all stages, built once per engine from the committed SPIR-V.

use crate::vulkan::{Device, Error, Kernel};

/// Whether the device runs a subgroup of eight invocations as one vector, as llvmpipe does: for it
/// some stages have a second form, without barriers and shared copies, two words an access.
fn in_lockstep(device: &Device) -> bool {
    let info = device.info();
    info.kind == "CPU" && info.subgroup == 8 && info.int64
}

/// Logarithm, base 2, of the number of workgroups that share a pass over so many splats; at least 2. A
/// CPU needs a few for each core; every further one costs it a row of counters. A GPU is filled by
/// many. No workgroup should have more than some thousand splats in any case: llvmpipe ends loops of
/// 65,535 rounds.
pub(crate) fn log_blocks(device: &Device, splats: u32) -> u32 {
    let least = if device.info().kind == "CPU" { 4 } else { 7 };
    (splats / 4096).max(1).ilog2().clamp(least, 8)
}

/// Defines [`Kernels`]: a field per entry point, with its shader file, its number of storage buffers
/// and its words of push constants; behind `or` its form for devices in lockstep.
macro_rules! kernels {
    ($($(#[$doc:meta])* $file:ident :: $name:ident $(or $eight:ident)?
        ($bindings:literal, $push:literal);)*) => {
        /// Pipelines of all stages.
        pub struct Kernels {
            $($(#[$doc])* pub(crate) $name: Kernel,)*
        }

        impl Kernels {
            /// Builds every pipeline.
            pub fn new(device: &Device) -> Result<Kernels, Error> {
                let lockstep = in_lockstep(device);
                Ok(Kernels {
                    $($name: {
                        let plain = module!($file, $name);
                        let (entry, spirv) = [plain, $(module!($file, $eight))?]
                            .into_iter()
                            .nth(lockstep.into())
                            .unwrap_or(plain);
                        Kernel::new(device, stringify!($name), entry, spirv, $bindings, $push)?
                    },)*
                })
            }
        }
    };
}

/// An entry point's name and its committed module.
macro_rules! module {
    ($file:ident, $name:ident) => {{
        let spirv: &[u8] =
            include_bytes!(concat!("../../shaders-rs/spv/", stringify!($name), ".spv"));
        (concat!(stringify!($file), "::", stringify!($name)), spirv)
    }};
}

kernels! {
    project::project or project_8 (6, 0);
    radix::radix_count or radix_count_8 (3, 4);
    radix::radix_scan or radix_scan_8 (2, 4);
    radix::radix_scatter or radix_scatter_8 (6, 4);
    bin::bin_count or bin_count_8 (5, 2);
    bin::bin_scan or bin_scan_8 (3, 2);
    bin::bin_emit or bin_emit_8 (8, 2);
    splat::splat(5, 0);
    splat_flow::splat_flow(6, 0);
    derive::derive(6, 0);
    splat_exact::splat_exact(7, 0);
    reduce::reduce(3, 0);
}
