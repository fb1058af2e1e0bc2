//! The compute pipelines of all stages, from the committed SPIR-V: built once per engine, and those that
//! depend on the prior once per kind of prior.

use crate::vulkan::{Code, Device, Error, Kernel};

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

/// Defines a set of pipelines: a field each, with its shader file, its number of storage buffers and its
/// words of push constants; then, where there is one, its form for devices in lockstep, and a
/// specialisation constant of its own.
macro_rules! kernels {
    ($(#[$doc:meta])* $set:ident: $($name:ident = $file:ident :: $entry:ident
        ($bindings:literal, $push:literal)
        $(, of eight: $lanes:ident)? $(, with $constant:ident = $value:literal)?;)*) => {
        $(#[$doc])*
        pub struct $set {
            $(pub(crate) $name: Kernel,)*
        }

        impl $set {
            /// Builds every pipeline, with these values of specialisation constants.
            fn build(device: &Device, constants: &[(u32, u32)]) -> Result<$set, Error> {
                let of_eight = in_lockstep(device);
                Ok($set {
                    $($name: {
                        let module = module!($file::$entry);
                        $(let module = if of_eight { module!($file::$lanes) } else { module };)?
                        let own = [$(($constant, $value))?];
                        let constants = [constants, own.as_slice()].concat();
                        let code = Code {
                            entry: module.0,
                            spirv: module.1,
                            bindings: $bindings,
                            push_words: $push,
                            constants: &constants,
                        };
                        Kernel::new(device, stringify!($entry), &code)?
                    },)*
                })
            }
        }
    };
}

kernels! {
    /// Pipelines that do not depend on the prior.
    Kernels:
    radix_count = radix::radix_count(3, 4), of eight: radix_count_8;
    radix_scan = radix::radix_scan(2, 4), of eight: radix_scan_8;
    radix_scatter = radix::radix_scatter(6, 4), of eight: radix_scatter_8;
    bin_count = bin::bin_count(5, 1), of eight: bin_count_8;
    bin_scan = bin::bin_scan(3, 1), of eight: bin_scan_8;
    bin_emit = bin::bin_emit(8, 1), of eight: bin_emit_8;
    reduce = reduce::reduce(3, 0);
    pyramid = pyramid::pyramid(3, 6);
    solve = solve::solve(7, 1);
    place = place::place(3, 0);
    finish = finish::finish(3, 0);
    difference = finish::difference(4, 0);
}

impl Kernels {
    /// Builds every pipeline.
    pub fn new(device: &Device) -> Result<Kernels, Error> {
        Kernels::build(device, &[])
    }
}

/// What of a prior its pipelines are made for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Traits {
    /// Degree of the spherical harmonics: code of higher ones is left out.
    pub sh_degree: u32,
    /// Whether a splat is so opaque that the clamp of alpha may hold it; else the clamp is left out.
    pub clamped: bool,
}

/// Specialisation constant: degree of the spherical harmonics.
const SH_DEGREE: u32 = 0;
/// Specialisation constant: 0 where no alpha needs the clamp.
const CLAMP: u32 = 1;
/// Specialisation constant: 0 where depths are not wanted.
const DEPTH: u32 = 2;

kernels! {
    /// Pipelines made for one kind of prior.
    SceneKernels:
    project = project::project(6, 0), of eight: project_8;
    splat = splat::splat(6, 0), of eight: splat_lanes;
    splat_colour = splat::splat(6, 0), of eight: splat_lanes, with DEPTH = 0;
    splat_flow = splat_flow::splat_flow(7, 0), of eight: splat_flow_lanes;
    derive = derive::derive(6, 0);
    splat_exact = splat_exact::splat_exact(8, 0);
}

impl SceneKernels {
    /// Builds every pipeline.
    pub fn new(device: &Device, traits: &Traits) -> Result<SceneKernels, Error> {
        let clamp = u32::from(traits.clamped);
        SceneKernels::build(device, &[(SH_DEGREE, traits.sh_degree), (CLAMP, clamp)])
    }
}
