//! What a driver's compiler makes of the pipelines that an engine builds. Nothing is submitted.

use crate::prior::Splats;
use crate::vulkan::{Compiled, Device, Error, Kernel};

use super::kernels::TrainingKernels;
use super::{FilterKernels, Kernels, PipelineKey, SceneKernels, arithmetic};

/// A pipeline of an engine, compiled.
#[derive(Clone, Debug)]
pub struct Stage {
    /// Its name among the engine's pipelines.
    pub name: &'static str,
    /// The kind of prior that it is made for, if it depends on that.
    pub prior: Option<PipelineKey>,
    /// What the compiler made of it.
    pub compiled: Compiled,
}

/// All kinds of priors.
pub fn prior_kinds() -> impl Iterator<Item = PipelineKey> {
    let degrees = 0..=Splats::MAX_SH_DEGREE;
    degrees.flat_map(|sh_degree| [false, true].map(|clamped| PipelineKey { sh_degree, clamped }))
}

/// Builds every pipeline of an engine on a device that was opened for inspection: those of encoder, decoder and
/// trainer, for all kinds of priors.
pub fn stages(device: &Device) -> Result<Vec<Stage>, Error> {
    let mut stages = vec![stage("arithmetic", None, &arithmetic::kernel(device)?)?];
    for (name, kernel) in Kernels::new(device)?.all() {
        stages.push(stage(name, None, kernel)?);
    }
    for prior in prior_kinds() {
        for (name, kernel) in SceneKernels::new(device, &prior)?.all() {
            stages.push(stage(name, Some(prior), kernel)?);
        }
    }
    for (name, kernel) in FilterKernels::new(device)?.all() {
        stages.push(stage(name, None, kernel)?);
    }
    for (name, kernel) in TrainingKernels::new(device, Splats::MAX_SH_DEGREE)?.all() {
        stages.push(stage(name, None, kernel)?);
    }
    Ok(stages)
}

fn stage(name: &'static str, prior: Option<PipelineKey>, kernel: &Kernel) -> Result<Stage, Error> {
    Ok(Stage { name, prior, compiled: kernel.compiled()? })
}
