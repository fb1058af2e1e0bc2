//! The compute pipelines of all stages, from the committed SPIR-V. They are built once per engine; those that depend on
//! the prior, once per kind of prior.

use nvsprior_kernels::modules;

use crate::shared::{BIN_TABLE, LOCKSTEP_TABLE};
use crate::vulkan::{Code, Device, DeviceInfo, DeviceKind, Error, Kernel};

/// Logarithm, base 2, of the number of workgroups that share the sort of `splats` splats. A CPU needs a few workgroups
/// per core, a GPU needs many. But each further one costs a row of counters, and each reads those of all others. An
/// integrated GPU has few multiprocessors and little bandwidth, so it gets half as many: docs/latency.md.
pub fn log_sort_blocks(device: &DeviceInfo, splats: u32) -> u32 {
    let least = match device.kind {
        DeviceKind::Cpu => 3,
        DeviceKind::IntegratedGpu => 5,
        _ => 6,
    };
    by_splats(splats).clamp(least, 7)
}

/// The same for binning, whose workgroups have more to do for each splat; at least 2.
pub fn log_bin_blocks(device: &DeviceInfo, splats: u32) -> u32 {
    let least = match device.kind {
        DeviceKind::Cpu => 4,
        DeviceKind::IntegratedGpu => 7,
        _ => 8,
    };
    by_splats(splats).clamp(least, 8)
}

/// Tiles of a band of tiles at most: counters of a workgroup that bins.
pub fn bin_table(device: &DeviceInfo) -> u32 {
    if device.in_lockstep() { LOCKSTEP_TABLE } else { BIN_TABLE }
}

/// Rows of tiles of a band at most. The splats of a block may touch many tiles or few, so a GPU, which waits for the
/// slowest workgroup, wants small bands. Each band goes through all splats, so a CPU wants large ones.
pub fn band_rows(device: &DeviceInfo) -> u32 {
    if device.kind == DeviceKind::Cpu { u32::MAX } else { 6 }
}

/// No workgroup should have more than some thousand splats: llvmpipe ends loops after 65,535 rounds.
fn by_splats(splats: u32) -> u32 {
    (splats / 4096).max(1).ilog2()
}

/// Defines a set of pipelines, one field per pipeline: its entry point, its number of storage buffers
/// and its words of push constants. Then, if it has them, its form for devices in lockstep
/// ([`DeviceInfo::in_lockstep`](crate::vulkan::DeviceInfo::in_lockstep)), its forms for waves of 16, 32 and 64
/// ([`DeviceInfo::wave`](crate::vulkan::DeviceInfo::wave)), and a specialisation constant of its own.
macro_rules! kernels {
    ($(#[$doc:meta])* $set:ident: $($name:ident = $entry:ident($bindings:literal, $push:literal)
        $(, in lockstep: $lockstep:ident)? $(, in waves: $w16:ident $w32:ident $w64:ident)?
        $(, with $constant:ident = $value:literal)?;)*) => {
        $(#[$doc])*
        pub struct $set {
            $(pub $name: Kernel,)*
        }

        impl $set {
            /// All of them, with their names here.
            #[cfg(feature = "inspection")]
            pub fn all(&self) -> impl Iterator<Item = (&'static str, &Kernel)> {
                [$((stringify!($name), &self.$name)),*].into_iter()
            }

            /// Builds every pipeline, with these values of specialisation constants.
            fn build(device: &Device, constants: &[(u32, u32)]) -> Result<$set, Error> {
                Ok($set {
                    $($name: {
                        let module = modules::$entry;
                        $(let module = if device.info().in_lockstep() { modules::$lockstep } else { module };)?
                        let subgroup = None;
                        $(let (module, subgroup) = match device.info().wave {
                            Some(16) => (modules::$w16, Some(16)),
                            Some(32) => (modules::$w32, Some(32)),
                            Some(64) => (modules::$w64, Some(64)),
                            _ => (module, subgroup),
                        };)?
                        let own = [$(($constant, $value))?];
                        let constants = [constants, own.as_slice()].concat();
                        let code = Code {
                            entry: module.entry,
                            spirv: module.spirv,
                            bindings: $bindings,
                            push_words: $push,
                            constants: &constants,
                            subgroup,
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
    radix_count = radix_count(3, 4), in lockstep: radix_count_lockstep;
    radix_scatter = radix_scatter(6, 4), in lockstep: radix_scatter_lockstep,
        in waves: radix_scatter_wave16 radix_scatter_wave32 radix_scatter_wave64;
    bin_count = bin_count(5, 1), in lockstep: bin_count_lockstep,
        in waves: bin_count_wave16 bin_count_wave32 bin_count_wave64;
    bin_scan = bin_scan(3, 1), in lockstep: bin_scan_lockstep,
        in waves: bin_scan_wave16 bin_scan_wave32 bin_scan_wave64;
    bin_emit = bin_emit(8, 1), in lockstep: bin_emit_lockstep,
        in waves: bin_emit_wave16 bin_emit_wave32 bin_emit_wave64;
    reduce = reduce(3, 0);
    pyramid = pyramid(4, 26);
    solve = solve(7, 0);
    quantize_rgb8 = quantize_rgb8(5, 1);
}

impl Kernels {
    /// Builds every pipeline.
    pub fn new(device: &Device) -> Result<Kernels, Error> {
        Kernels::build(device, &[])
    }
}

/// The properties of a prior that its pipelines are made for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PipelineKey {
    /// Degree of the spherical harmonics: code of higher ones is left out.
    pub sh_degree: u32,
    /// Whether any splat is so opaque that alpha may need the clamp. Else the clamp is left out.
    pub clamped: bool,
}

/// Specialisation constant: degree of the spherical harmonics.
const SH_DEGREE: u32 = 0;
/// Specialisation constant: 0 if no alpha needs the clamp.
const CLAMP: u32 = 1;
/// Specialisation constant: 0 if depths are not wanted.
const DEPTH: u32 = 2;

kernels! {
    /// Pipelines made for one kind of prior.
    SceneKernels:
    project = project(8, 3), in lockstep: project_lockstep;
    splat = splat(6, 0), in lockstep: splat_lockstep, in waves: splat_wave16 splat_wave32 splat_wave64;
    splat_colour = splat(6, 0), in lockstep: splat_lockstep, in waves: splat_wave16 splat_wave32 splat_wave64,
        with DEPTH = 0;
    splat_flow = splat_flow(7, 0), in lockstep: splat_flow_lockstep,
        in waves: splat_flow_wave16 splat_flow_wave32 splat_flow_wave64;
    pose_jacobian = pose_jacobian(6, 0);
    splat_exact = splat_exact(8, 0);
}

impl SceneKernels {
    /// Builds every pipeline.
    pub fn new(device: &Device, traits: &PipelineKey) -> Result<SceneKernels, Error> {
        let clamp = u32::from(traits.clamped);
        SceneKernels::build(device, &[(SH_DEGREE, traits.sh_degree), (CLAMP, clamp)])
    }
}

kernels! {
    /// The display filter's pipeline.
    FilterKernels:
    filter_layer = filter_layer(4, 6);
}

impl FilterKernels {
    /// Builds it.
    pub fn new(device: &Device) -> Result<FilterKernels, Error> {
        FilterKernels::build(device, &[])
    }
}

kernels! {
    /// Pipelines of training.
    TrainingKernels:
    train_activate = train_activate(5, 0), in lockstep: train_activate_lockstep;
    train_slots = train_slots(7, 0);
    ssim_rows = ssim_rows(4, 0), in lockstep: ssim_rows_lockstep;
    ssim_columns = ssim_columns(4, 0), in lockstep: ssim_columns_lockstep;
    ssim_back = ssim_back(4, 0), in lockstep: ssim_back_lockstep;
    ssim_gradient = ssim_gradient(7, 0), in lockstep: ssim_gradient_lockstep;
    loss_gradient = loss_gradient(5, 0);
    splat_backward = splat_backward(8, 0), in lockstep: splat_backward_lockstep;
    train_gradient = train_gradient(8, 0);
    train_step = train_step(11, 0), in lockstep: train_step_lockstep;
}

impl TrainingKernels {
    /// Builds every pipeline.
    pub fn new(device: &Device, sh_degree: u32) -> Result<TrainingKernels, Error> {
        TrainingKernels::build(device, &[(SH_DEGREE, sh_degree)])
    }
}
