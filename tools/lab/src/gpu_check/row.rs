//! A row of the report: a pipeline as the compiler made it.

use anyhow::Context as _;
use nvsprior::render::PipelineKey;
use nvsprior::render::inspection::{Stage, prior_kinds};
use nvsprior_kernels::modules;
use serde::{Deserialize, Serialize};

use super::lanes::workers;

/// Subgroups that a SIMD of RDNA 2 holds at most, as RADV counts them.
const SUBGROUPS_PER_SIMD: f64 = 32.0;

/// A pipeline.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// The driver with its version, on which all figures depend.
    pub compiler: String,
    /// Its name in the engine.
    pub stage: String,
    /// The priors that it is for, if the code depends on them.
    pub variant: String,
    /// Its file in `shaders-rs/kernels/spv`, without the ending.
    pub module: String,
    /// Invocations of a subgroup that the driver was told to compile for.
    pub subgroup: u32,
    /// Those that it has compiled for: newer drivers take fewer for small workgroups.
    pub compiled_subgroup: u32,
    /// Invocations of a workgroup.
    pub workgroup: u32,
    /// Invocations that work, as a share of the lanes of the workgroup's subgroups.
    pub lanes_used: f64,
    /// Vector registers.
    pub registers: u32,
    /// Scalar registers that the code needs; the hardware always allots 128.
    pub scalar_registers: u32,
    /// Registers, of both kinds, that were spilled.
    pub spills: u32,
    /// Memory of each invocation for what is in no register, bytes.
    pub scratch_bytes: u32,
    /// Shared memory of a workgroup.
    pub shared_bytes: u32,
    /// Subgroups per SIMD, as a share of the most.
    pub occupancy: f64,
    /// All instructions that stand in the code.
    pub instructions: u32,
}

/// The rows of some stages; one for all kinds of priors for which the figures are the same.
pub fn rows(stages: &[Stage], compiler: &str, subgroup: u32) -> anyhow::Result<Vec<Row>> {
    let mut merged: Vec<(Row, Vec<PipelineKey>)> = Vec::new();
    for stage in stages {
        let row = Row::of(stage, compiler, subgroup);
        let row = row.with_context(|| format!("pipeline {}", stage.name))?;
        match merged.iter_mut().find(|(other, _)| *other == row) {
            Some((_, priors)) => priors.extend(stage.prior),
            None => merged.push((row, stage.prior.into_iter().collect())),
        }
    }
    // The engine's order, with the variants of a stage side by side.
    merged.sort_by_key(|(row, _)| stages.iter().position(|stage| stage.name == row.stage));
    let named = |(row, priors): (Row, Vec<_>)| Row { variant: variant(&priors), ..row };
    Ok(merged.into_iter().map(named).collect())
}

/// Names some kinds of priors by what they have in common.
fn variant(priors: &[PipelineKey]) -> String {
    if prior_kinds().all(|kind| priors.contains(&kind)) {
        return String::new();
    }
    let Some(first) = priors.first() else { return String::new() };
    let degrees = prior_kinds().filter(|kind| kind.clamped == first.clamped);
    let degrees: Vec<u32> =
        degrees.filter(|kind| priors.contains(kind)).map(|kind| kind.sh_degree).collect();
    let all_degrees = prior_kinds().filter(|kind| kind.clamped).count() == degrees.len();
    let degrees = degrees.iter().map(u32::to_string).collect::<Vec<_>>().join(", ");
    let both = priors.contains(&PipelineKey { clamped: !first.clamped, ..*first });
    let clamp = if first.clamped { "clamp" } else { "no clamp" };
    match (all_degrees, both) {
        (true, _) => clamp.into(),
        (false, true) => format!("degree {degrees}"),
        (false, false) => format!("degree {degrees}, {clamp}"),
    }
}

impl Row {
    fn of(stage: &Stage, compiler: &str, subgroup: u32) -> anyhow::Result<Row> {
        let compiled = &stage.compiled;
        let module = compiled.entry.rsplit("::").next().unwrap_or_default();
        let workgroup = workgroup(module)?;
        let workers = workers(module).unwrap_or(workgroup);
        let statistic = |name: &str| {
            let found = compiled.statistics.iter().find(|(own, _)| own.eq_ignore_ascii_case(name));
            found
                .map(|(_, value)| *value)
                .with_context(|| format!("the driver tells no \"{name}\""))
        };
        let whole = |name: &str| statistic(name).map(|value| value as u32);
        let occupancy = statistic("Subgroups per SIMD")? / SUBGROUPS_PER_SIMD;
        anyhow::ensure!(occupancy <= 1.0, "more subgroups per SIMD than {SUBGROUPS_PER_SIMD}");
        Ok(Row {
            compiler: compiler.into(),
            stage: stage.name.into(),
            variant: String::new(),
            module: module.into(),
            subgroup,
            compiled_subgroup: compiled.subgroup,
            workgroup,
            lanes_used: lanes_used(workers, workgroup, compiled.subgroup),
            registers: whole("VGPRs")?,
            scalar_registers: whole("Pre-Sched SGPRs")?,
            spills: whole("Spilled SGPRs")? + whole("Spilled VGPRs")?,
            scratch_bytes: whole("Scratch size")?,
            shared_bytes: whole("LDS size")?,
            occupancy,
            instructions: whole("Instructions")?,
        })
    }

    /// Its name for people.
    pub fn name(&self) -> String {
        match self.variant.as_str() {
            "" => self.stage.clone(),
            variant => format!("{}, {variant}", self.stage),
        }
    }
}

/// Invocations that work, as a share of the lanes of a workgroup's subgroups.
fn lanes_used(workers: u32, workgroup: u32, subgroup: u32) -> f64 {
    f64::from(workers) / f64::from(workgroup.next_multiple_of(subgroup.max(1)))
}

/// Invocations of a module's workgroup, from its execution mode.
fn workgroup(module: &str) -> anyhow::Result<u32> {
    const HEADER: usize = 5;
    const OP_EXECUTION_MODE: u32 = 16;
    const LOCAL_SIZE: u32 = 17;
    let named = |m: &&modules::Module| m.entry.rsplit("::").next() == Some(module);
    let found = modules::ALL.iter().find(named).with_context(|| format!("no module {module}"))?;
    let words: Vec<u32> = bytemuck::pod_collect_to_vec(found.spirv);
    let mut rest = words.get(HEADER..).unwrap_or_default();
    while let [first, ..] = rest {
        let count = (first >> 16).max(1) as usize;
        if let [_, _, LOCAL_SIZE, x, y, z, ..] = rest
            && first & 0xffff == OP_EXECUTION_MODE
        {
            return Ok(x * y * z);
        }
        rest = rest.get(count..).unwrap_or_default();
    }
    anyhow::bail!("module {module} has no LocalSize")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn workgroups_are_read_from_the_modules() {
        assert_eq!(workgroup("bin_count_wave16").unwrap(), 16);
        assert_eq!(workgroup("project").unwrap(), 128);
        assert!(workgroup("nothing").is_err());
    }

    #[test]
    fn lanes_of_the_last_subgroup_may_be_idle() {
        assert_eq!(lanes_used(256, 256, 64), 1.0);
        assert_eq!(lanes_used(16, 16, 32), 0.5);
        assert_eq!(lanes_used(48, 48, 32), 0.75);
        assert_eq!(lanes_used(1, 256, 32), 1.0 / 256.0);
    }

    #[test]
    fn variants_are_named_by_what_they_depend_on() {
        let those = |test: fn(&PipelineKey) -> bool| {
            variant(&prior_kinds().filter(test).collect::<Vec<_>>())
        };
        assert_eq!(those(|_| true), "");
        assert_eq!(those(|kind| kind.clamped), "clamp");
        assert_eq!(those(|kind| kind.sh_degree == 2), "degree 2");
        assert_eq!(those(|kind| kind.sh_degree > 1), "degree 2, 3");
        assert_eq!(those(|kind| kind.sh_degree == 0 && !kind.clamped), "degree 0, no clamp");
        assert_eq!(variant(&[]), "");
    }
}
