//! Measures what a device can do at best: the rate of multiply-adds in registers and the rate of copying words. Stages
//! are reported as shares of these.

use nvsprior_kernels::modules::{self, Module};

use nvsprior::vulkan::{Buffer, Code, Device, Error, Kernel, Memory, Recorder, Timing};
use nvsprior_kernels::shared::{CEILING_CHAINS, CEILING_STEPS, CEILING_TURNS};

/// A device's best rates.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Ceilings {
    /// Floating-point operations per second; a multiply-add is two.
    pub flops: f64,
    /// Bytes per second of a copy by 32-bit words; bytes read and bytes written count.
    #[serde(rename = "copy_bytes")]
    pub bytes: f64,
}

/// Invocations of a workgroup of both kernels.
const THREADS: usize = 256;
/// Invocations of the arithmetic kernel.
const CHAINED: usize = 1 << 14;
/// Words that the copy kernel copies: more than caches hold, 32 MiB.
const WORDS: usize = 1 << 22;
/// Runs; the fastest counts.
const RUNS: usize = 5;

/// Measures a device. Takes a few tenths of a second on a CPU.
pub fn measure(device: &Device) -> Result<Ceilings, Error> {
    let operations = CHAINED as f64 * f64::from(CEILING_CHAINS * CEILING_STEPS * CEILING_TURNS);
    Ok(Ceilings {
        flops: 2.0 * operations / arithmetic(device)?,
        bytes: 8.0 * WORDS as f64 / copy(device)?,
    })
}

/// Seconds of the arithmetic kernel.
fn arithmetic(device: &Device) -> Result<f64, Error> {
    let kernel = kernel(device, "ceiling_arithmetic", &modules::ceiling_arithmetic)?;
    let offset = Buffer::from_slice(device, "offset", &[0.1f32])?;
    let out = Buffer::new::<f32>(device, "chains", CHAINED, Memory::Device)?;
    fastest(device, &kernel, &[&offset, &out], CHAINED)
}

/// Seconds of the copy kernel.
fn copy(device: &Device) -> Result<f64, Error> {
    let kernel = kernel(device, "ceiling_copy", &modules::ceiling_copy)?;
    let from = Buffer::new::<u32>(device, "words", WORDS, Memory::Device)?;
    let to = Buffer::new::<u32>(device, "copied words", WORDS, Memory::Device)?;
    fastest(device, &kernel, &[&from, &to], WORDS)
}

fn kernel(device: &Device, name: &'static str, module: &Module) -> Result<Kernel, Error> {
    let &Module { entry, spirv } = module;
    Kernel::new(
        device,
        name,
        &Code { entry, spirv, bindings: 2, push_words: 0, constants: &[], subgroup: None },
    )
}

/// Device time of the fastest run, seconds.
fn fastest(
    device: &Device,
    kernel: &Kernel,
    buffers: &[&Buffer],
    invocations: usize,
) -> Result<f64, Error> {
    let mut recorder = Recorder::new(device, Timing::Stages)?;
    recorder.dispatch(kernel, buffers, &[], [(invocations / THREADS) as u32, 1, 1])?;
    let mut commands = recorder.finish()?;
    let mut best = f64::INFINITY;
    for _ in 0..RUNS {
        commands.run()?;
        let times = commands.stage_times()?;
        best = times.iter().map(|stage| stage.milliseconds * 1e-3).fold(best, f64::min);
    }
    Ok(best)
}
