//! GPUs whose figures are known well enough to predict stages on them, and the compiled stages that this takes.

use anyhow::Context as _;

use super::{Cost, Gpu, Machine, Sharing, Times};
use crate::gpu_check::Row;

/// A GPU, as both models see it.
#[derive(Clone, Copy, Debug)]
pub struct KnownGpu {
    /// A device is this GPU if its own name, or its board's, has this text.
    pub part_of_name: &'static str,
    /// By operations.
    pub machine: Machine,
    /// By what a compiler makes of the stages.
    pub gpu: Gpu,
}

/// Jetson Orin NX 16GB: docs/latency.md. Published (CUDA C++ Programming Guide, compute capability 8.7): what a
/// multiprocessor holds, and 16 transcendental operations per cycle. Assumed: cycles until a result or a load is there.
pub const ORIN_NX: KnownGpu = KnownGpu {
    part_of_name: "Orin NX",
    machine: Machine {
        name: "Orin NX",
        flops: 0.9 * 1.88e12,
        bytes: 0.65 * 102.4e9,
        latency: 300.0 / 918e6,
        dispatch: 5e-6,
        sharing: Sharing::GPU,
    },
    gpu: Gpu {
        multiprocessors: 8.0,
        schedulers: 4.0,
        clock: 918e6,
        subgroups: 48.0,
        workgroups: 16.0,
        registers: 65_536.0,
        shared_bytes: 164.0 * 1024.0,
        load: 300.0,
        shared_load: 30.0,
        transcendental: 8.0,
    },
};

/// H100 SXM, to hold the model against a measured device: docs/latency.md. Published (NVIDIA H100 data sheet; CUDA C++
/// Programming Guide, compute capability 9.0): 66.9 TFLOP/s, 3.35 TB/s, and what a multiprocessor holds. Assumed: as
/// for the Orin NX, the shares of these rates, and cycles until a result or a load is there.
pub const H100: KnownGpu = KnownGpu {
    part_of_name: "H100",
    machine: Machine {
        name: "H100",
        flops: 0.9 * 66.9e12,
        bytes: 0.65 * 3.35e12,
        latency: 300.0 / 1.98e9,
        dispatch: 5e-6,
        sharing: Sharing::LARGE_GPU,
    },
    gpu: Gpu {
        multiprocessors: 132.0,
        schedulers: 4.0,
        clock: 1.98e9,
        subgroups: 64.0,
        workgroups: 32.0,
        registers: 65_536.0,
        shared_bytes: 228.0 * 1024.0,
        load: 300.0,
        shared_load: 30.0,
        transcendental: 8.0,
    },
};

const ALL: [KnownGpu; 2] = [ORIN_NX, H100];

/// Invocations of a subgroup of all known GPUs.
pub const SUBGROUP: u32 = 32;

/// What `make gpu-check RENEW=1` writes.
const COMPILED: &str = include_str!("compiled.json");

/// The stages of the model as Mesa's RADV compiles them for subgroups of 32.
pub fn compiled_rows() -> anyhow::Result<Vec<Row>> {
    serde_json::from_str(COMPILED).context("reading the compiled stages that the program holds")
}

impl KnownGpu {
    /// The GPU that one of these names is of: a device's, or its board's.
    pub fn of(names: &[&str]) -> Option<KnownGpu> {
        ALL.into_iter().find(|known| names.iter().any(|name| name.contains(known.part_of_name)))
    }

    /// What a stage should take, by its compiled form; `None` for stages that are not modelled. If it has several forms
    /// for kinds of priors, the one with the most instructions counts.
    pub fn times(&self, rows: &[Row], stage: &str, cost: &Cost) -> anyhow::Result<Option<Times>> {
        let own = rows.iter().filter(|row| row.stage == stage && row.subgroup == SUBGROUP);
        let Some(row) = own.max_by_key(|row| row.instructions) else { return Ok(None) };
        self.gpu.times(row, cost, self.machine.bytes, self.machine.dispatch)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gpus_are_known_by_the_name_of_device_or_board() {
        let orin =
            KnownGpu::of(&["NVIDIA Tegra Orin (nvgpu)", "NVIDIA Jetson Orin NX Developer Kit"]);
        assert_eq!(orin.unwrap().machine.name, "Orin NX");
        assert!(KnownGpu::of(&["NVIDIA Tegra Orin (nvgpu)", ""]).is_none());
    }

    #[test]
    fn the_program_holds_the_compiled_stages_of_a_frame() {
        let rows = compiled_rows().unwrap();
        for stage in ["project", "radix_scatter", "bin_emit", "splat_colour", "splat_flow", "solve"]
        {
            let row = rows.iter().find(|row| row.stage == stage);
            let row = row.unwrap_or_else(|| panic!("no stage {stage}"));
            assert!(row.subgroup == SUBGROUP && row.instructions > 0, "{stage}");
        }
    }
}
