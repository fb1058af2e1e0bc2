//! Stage `arithmetic`: tests whether a device computes the operations of portable pictures to the same bits.

use crate::portable::{RESULTS, sample};
use crate::random::Random;
use crate::vulkan::{Buffer, Code, Device, Error, Kernel, Memory, Recorder, Timing};

/// Threes of numbers.
const SAMPLES: usize = 4096;
/// Invocations of a workgroup.
const GROUP: usize = 64;

/// Whether it does, on numbers of all sizes that occur.
pub(crate) fn agrees(device: &Device) -> Result<bool, Error> {
    let mut random = Random::new(13);
    let numbers: Vec<[f32; 3]> = (0..SAMPLES).map(|_| numbers(&mut random)).collect();
    let kernel = kernel(device)?;
    let from = Buffer::from_slice(device, "numbers", &numbers)?;
    let count = SAMPLES * RESULTS;
    let results = Buffer::new::<f32>(device, "results", count, Memory::Device)?;
    let read = Buffer::new::<f32>(device, "results read back", count, Memory::Readback)?;
    let mut recorder = Recorder::new(device, Timing::None)?;
    recorder.dispatch(&kernel, &[&from, &results], &[], [(SAMPLES / GROUP) as u32, 1, 1])?;
    recorder.copy(&results, &read);
    recorder.finish()?.run()?;
    let expected = numbers.iter().flat_map(|[a, b, c]| sample(*a, *b, *c));
    Ok(std::iter::zip(read.read::<f32>(count), expected).all(|(a, b)| a.to_bits() == b.to_bits()))
}

/// The stage's pipeline.
pub(crate) fn kernel(device: &Device) -> Result<Kernel, Error> {
    let module = nvsprior_kernels::modules::arithmetic;
    let (entry, spirv) = (module.entry, module.spirv);
    let code = Code { entry, spirv, bindings: 2, push_words: 0, constants: &[], subgroup: None };
    Kernel::new(device, "arithmetic", &code)
}

/// A positive number, one of any sign, and an exponent.
fn numbers(random: &mut Random) -> [f32; 3] {
    let size = 2_f32.powi((random.bits() % 61) as i32 - 30);
    let near = size * random.within(-2.0, 2.0);
    [size * random.within(1.0, 2.0), near, random.within(-10.0, 10.0)]
}
