//! Measures what a device can do at best: the rate of multiply-adds in registers and the rate of copying words. Stages
//! are reported as shares of these.

use std::time::{Duration, Instant};

use nvsprior_kernels::modules::{self, Module};

use nvsprior::vulkan::{
    Buffer, Code, Commands, Device, DeviceInfo, DeviceKind, Error, Kernel, Memory, Recorder, Timing,
};
use nvsprior_kernels::shared::{CEILING_CHAINS, CEILING_STEPS, CEILING_TURNS, Params};

/// A device's best rates.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Ceilings {
    /// Floating-point operations per second; a multiply-add is two.
    pub flops: f64,
    /// Bytes per second of a copy by 32-bit words; bytes read and bytes written count.
    #[serde(rename = "copy_bytes")]
    pub bytes: f64,
}

/// Whose clock times the runs. The host's counts submission and wait, too.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Clock {
    Device,
    Host,
}

impl Clock {
    /// The device's own, if it has one.
    pub fn of(device: &Device) -> Clock {
        if device.timestamps() { Clock::Device } else { Clock::Host }
    }
}

/// Invocations of a workgroup of both kernels.
const THREADS: usize = 256;
/// Invocations of the arithmetic kernel, and words that the copy kernel copies: more than caches hold. So many on a
/// CPU.
const ON_CPU: [usize; 2] = [1 << 14, 1 << 22];
/// The same on a GPU. An H100 holds 270,000 invocations at once, and 50 MB in its cache.
const ON_GPU: [usize; 2] = [1 << 18, 1 << 24];
/// Runs; the fastest counts.
const RUNS: usize = 5;
/// Empty dispatches in a row; the first of them does not count.
const DISPATCHES: usize = 65;

/// Measures a device by its own clock, if it has one. Takes a few tenths of a second on a CPU.
pub fn measure(device: &Device) -> Result<Ceilings, Error> {
    measure_by(device, Clock::of(device))
}

/// As [`measure`], by a given clock.
pub fn measure_by(device: &Device, clock: Clock) -> Result<Ceilings, Error> {
    let cpu = device.info().kind == DeviceKind::Cpu;
    let [invocations, words] = if cpu { ON_CPU } else { ON_GPU };
    let operations = invocations as f64 * f64::from(CEILING_CHAINS * CEILING_STEPS * CEILING_TURNS);
    Ok(Ceilings {
        flops: 2.0 * operations / arithmetic(device, clock, invocations)?,
        bytes: 8.0 * words as f64 / copy(device, clock, words)?,
    })
}

/// Seconds of a dispatch that does nothing, with its barrier.
pub fn dispatch_seconds(device: &Device, clock: Clock) -> Result<f64, Error> {
    let params = Buffer::from_slice(device, "parameters", &[Params::default()])?;
    let none = Buffer::new::<f32>(device, "nothing", 1, Memory::Device)?;
    let kernel = kernel(device, "quantize_rgb8", &modules::quantize_rgb8, 5, 1)?;
    let record = |count| {
        let mut recorder = Recorder::new(device, Timing::Stages)?;
        for _ in 0..count {
            recorder.dispatch(&kernel, &[&params, &none, &none, &none, &none], &[0], [1, 1, 1])?;
        }
        recorder.finish()
    };
    let (mut one, mut many) = (record(1)?, record(DISPATCHES)?);
    let mut best = f64::INFINITY;
    let (mut least_one, mut least_many) = (f64::INFINITY, f64::INFINITY);
    for () in runs(device.info()) {
        least_one = least_one.min(host_seconds(&mut one)?);
        least_many = least_many.min(host_seconds(&mut many)?);
        let times = many.stage_times()?;
        best = times.iter().skip(1).map(|time| time.milliseconds * 1e-3).fold(best, f64::min);
    }
    Ok(match clock {
        Clock::Device => best,
        Clock::Host => (least_many - least_one).max(0.0) / (DISPATCHES - 1) as f64,
    })
}

/// For so long a job runs before it is timed: the clock of a GPU that was idle rises only under load. With one run
/// before, stages of an H100 took up to four times as long.
pub fn warm_up(device: &DeviceInfo) -> Duration {
    if device.kind == DeviceKind::Cpu { Duration::ZERO } else { Duration::from_millis(600) }
}

/// An item for each run: at least [`RUNS`], and so many as the warm-up takes.
fn runs(device: &DeviceInfo) -> impl Iterator<Item = ()> {
    let (start, least) = (Instant::now(), warm_up(device));
    (0..).take_while(move |run| *run < RUNS || start.elapsed() < least).map(|_| ())
}

/// Seconds of the arithmetic kernel.
fn arithmetic(device: &Device, clock: Clock, invocations: usize) -> Result<f64, Error> {
    let kernel = kernel(device, "ceiling_arithmetic", &modules::ceiling_arithmetic, 2, 0)?;
    let offset = Buffer::from_slice(device, "offset", &[0.1f32])?;
    let out = Buffer::new::<f32>(device, "chains", invocations, Memory::Device)?;
    fastest(device, clock, &kernel, &[&offset, &out], invocations)
}

/// Seconds of the copy kernel.
fn copy(device: &Device, clock: Clock, words: usize) -> Result<f64, Error> {
    let kernel = kernel(device, "ceiling_copy", &modules::ceiling_copy, 2, 0)?;
    let from = Buffer::new::<u32>(device, "words", words, Memory::Device)?;
    let to = Buffer::new::<u32>(device, "copied words", words, Memory::Device)?;
    fastest(device, clock, &kernel, &[&from, &to], words)
}

fn kernel(
    device: &Device,
    name: &'static str,
    module: &Module,
    bindings: u32,
    push_words: u32,
) -> Result<Kernel, Error> {
    let &Module { entry, spirv } = module;
    Kernel::new(
        device,
        name,
        &Code { entry, spirv, bindings, push_words, constants: &[], subgroup: None },
    )
}

/// Time of the fastest run, seconds.
fn fastest(
    device: &Device,
    clock: Clock,
    kernel: &Kernel,
    buffers: &[&Buffer],
    invocations: usize,
) -> Result<f64, Error> {
    let mut recorder = Recorder::new(device, Timing::Stages)?;
    recorder.dispatch(kernel, buffers, &[], [(invocations / THREADS) as u32, 1, 1])?;
    let mut commands = recorder.finish()?;
    let mut best = f64::INFINITY;
    for () in runs(device.info()) {
        let seconds = host_seconds(&mut commands)?;
        best = match clock {
            Clock::Host => best.min(seconds),
            Clock::Device => {
                let times = commands.stage_times()?;
                times.iter().map(|stage| stage.milliseconds * 1e-3).fold(best, f64::min)
            }
        };
    }
    Ok(best)
}

/// Seconds from the submission to the end, as the host sees it.
fn host_seconds(commands: &mut Commands) -> Result<f64, Error> {
    let since = Instant::now();
    commands.run()?;
    Ok(since.elapsed().as_secs_f64())
}

#[cfg(test)]
mod tests {
    use nvsprior::Engine;

    use super::*;

    #[test]
    fn the_hosts_clock_sees_about_the_same_as_the_devices() {
        let engine = Engine::new(&Default::default()).unwrap();
        let device = engine.vulkan();
        assert_eq!(Clock::of(device), Clock::Device, "Mesa's CPU driver has timestamps");
        let [own, host] =
            [Clock::Device, Clock::Host].map(|clock| measure_by(device, clock).unwrap());
        // Other programs may take the processor in between.
        for ratio in [host.flops / own.flops, host.bytes / own.bytes] {
            assert!((0.1..10.0).contains(&ratio), "{own:?} {host:?}");
        }
        let [own, host] =
            [Clock::Device, Clock::Host].map(|clock| dispatch_seconds(device, clock).unwrap());
        assert!(own > 0.0 && own < 0.1 && (0.0..0.1).contains(&host), "{own} {host}");
    }
}
