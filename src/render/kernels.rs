//! The compute pipelines of all stages, built once per engine from the committed SPIR-V.

use crate::vulkan::{Device, Error, Kernel};

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
/// and its words of push constants; then, where there is one, the entry point for devices whose
/// subgroups are of eight invocations and can shuffle.
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
                let info = device.info();
                let of_eight = info.subgroup == 8 && info.shuffles;
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
    project::project(7, 0);
    bin::bin_count(4, 0);
    bin::bin_scan(3, 0);
    bin::bin_emit(7, 0);
    radix::radix_count(3, 2);
    radix::radix_scan(2, 2);
    radix::radix_scatter(6, 2);
    ranges::ranges(4, 0);
    splat::splat(5, 0), of eight: splat_lanes;
    splat_flow::splat_flow(6, 0), of eight: splat_flow_lanes;
    derive::derive(6, 0);
    splat_exact::splat_exact(7, 0);
    reduce::reduce(3, 0);
    pyramid::pyramid(2, 6);
    solve::solve(7, 1);
    place::place(3, 0);
    finish::finish(3, 0);
    finish::difference(4, 0);
}
