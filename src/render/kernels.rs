//! The compute pipelines of all stages, built once per engine from the committed SPIR-V.

use crate::vulkan::{Device, Error, Kernel};

/// Whether the device runs a subgroup of eight invocations as one vector, as llvmpipe does: for it
/// some stages have a second form, without barriers and shared copies, two words an access, in which
/// lanes hand each other what they have loaded.
fn in_lockstep(device: &Device) -> bool {
    let info = device.info();
    info.kind == "CPU" && info.subgroup == 8 && info.int64 && info.shuffles
}

/// Logarithm, base 2, of the number of workgroups that share a pass over so many splats; at least 2. A
/// CPU needs a few for each core; every further one costs it a row of counters. A GPU is filled by
/// many. No workgroup should have more than some thousand splats in any case: llvmpipe ends loops of
/// 65,535 rounds.
pub(crate) fn log_blocks(device: &Device, splats: u32) -> u32 {
    let least = if device.info().kind == "CPU" { 4 } else { 7 };
    (splats / 4096).max(1).ilog2().clamp(least, 8)
}

/// An entry point's name and module.
macro_rules! module {
    ($file:ident :: $name:ident) => {
        (
            concat!(stringify!($file), "::", stringify!($name)),
            include_bytes!(concat!("../../shaders-rs/spv/", stringify!($name), ".spv")).as_slice(),
        )
    };
}

/// Defines [`Kernels`]: a field per entry point, with its shader file, its number of storage buffers
/// and its words of push constants; then, where there is one, its form for devices in lockstep.
macro_rules! kernels {
    ($($(#[$doc:meta])* $file:ident :: $name:ident ($bindings:literal, $push:literal)
        $(, of eight: $lanes:ident)?;)*) => {
        /// Pipelines of all stages.
        pub struct Kernels {
            $($(#[$doc])* pub(crate) $name: Kernel,)*
        }

        impl Kernels {
            /// Builds every pipeline.
            pub fn new(device: &Device) -> Result<Kernels, Error> {
                let of_eight = in_lockstep(device);
                Ok(Kernels {
                    $($name: {
                        let module = module!($file::$name);
                        $(let module = if of_eight { module!($file::$lanes) } else { module };)?
                        let (entry, spirv) = module;
                        Kernel::new(device, stringify!($name), entry, spirv, $bindings, $push)?
                    },)*
                })
            }
        }
    };
}

kernels! {
    project::project(6, 0), of eight: project_8;
    radix::radix_count(3, 4), of eight: radix_count_8;
    radix::radix_scan(2, 4), of eight: radix_scan_8;
    radix::radix_scatter(6, 4), of eight: radix_scatter_8;
    bin::bin_count(5, 1), of eight: bin_count_8;
    bin::bin_scan(3, 1), of eight: bin_scan_8;
    bin::bin_emit(8, 1), of eight: bin_emit_8;
    splat::splat(6, 0), of eight: splat_lanes;
    splat_flow::splat_flow(7, 0), of eight: splat_flow_lanes;
    derive::derive(6, 0);
    splat_exact::splat_exact(8, 0);
    reduce::reduce(3, 0);
    pyramid::pyramid(2, 6);
    solve::solve(7, 1);
    place::place(3, 0);
    finish::finish(3, 0);
    finish::difference(4, 0);
}
