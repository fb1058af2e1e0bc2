//! Stage `train_step`: the loss's gradient by all parameters, and one step of them along it (Adam, Kingma and Ba 2015),
//! with the pulls and the noise of 3DGS-MCMC (Kheradmand et al. 2024). Nothing is done if the pairs or the slots did
//! not fit: the host makes room and runs the step again.

use crate::memory::{at, at_mut};
use crate::shared::{Counters, Params, dot};
use crate::splat_gradient::Gradient;
use crate::train_activate::Shape;
use crate::training::{FADING, LOG_SCALE, OPACITY, POSITION, ROTATION, SH, SlotCounters, Training};
use spirv_std::glam::{UVec3, Vec4};
use spirv_std::num_traits::Float;
use spirv_std::spirv;

/// Keeps steps finite: a gradient of a mean over all pixels is small.
const EPSILON: f32 = 1e-15;
/// Noise moves splats of less opacity than about this one, and none of more.
const FAINT: f32 = 0.005;
/// How sharply it tells them apart.
const SHARPNESS: f32 = 100.0;

/// One step of the parameter at a place, along its gradient.
fn step(
    training: &Training,
    parameters: &mut [f32],
    first: &mut [f32],
    second: &mut [f32],
    place: u32,
    rate: f32,
    gradient: f32,
) {
    let mean = at::<f32, _>(first, place);
    let mean = mean + (1.0 - FADING[0]) * (gradient - mean);
    let square = at::<f32, _>(second, place);
    let square = square + (1.0 - FADING[1]) * (gradient * gradient - square);
    *at_mut(first, place) = mean;
    *at_mut(second, place) = square;
    let spread = (square * training.unbias[1]).sqrt() + EPSILON;
    *at_mut(parameters, place) -= rate * (mean * training.unbias[0]) / spread;
}

/// A number's bits, mixed (PCG, Jarzynski and Olano 2020).
fn mixed(value: u32) -> u32 {
    let state = value.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    word >> 22 ^ word
}

/// Bits as a number between 0 and 1, not included.
fn even(bits: u32) -> f32 {
    ((bits >> 8) as f32 + 0.5) * (1.0 / 16_777_216.0)
}

/// Two numbers of a normal distribution (Box and Muller 1958).
fn normal(seed: u32) -> [f32; 2] {
    let one = mixed(seed);
    let two = mixed(one);
    let length = (-2.0 * even(one).ln()).sqrt();
    let angle = core::f32::consts::TAU * even(two);
    [length * angle.cos(), length * angle.sin()]
}

/// Moves a faint splat's position by noise of its own covariance.
fn shake(training: &Training, parameters: &mut [f32], n: u32, j: u32) {
    let shape = Shape::load(training, parameters, j);
    let faint = 1.0 / (1.0 + (SHARPNESS * (shape.opacity - FAINT)).exp());
    let size = training.noise * faint;
    // Most splats are not faint.
    if size > 1e-12 {
        let seed = mixed(training.step ^ mixed(j));
        let ([a, b], [c, _]) = (normal(seed), normal(seed ^ 0x9e37_79b9));
        let axes = shape.unit_axes();
        let [s0, s1, s2] = shape.scale;
        let noise = [a, b, c];
        let x = size * s0 * s0 * dot(axes[0], noise);
        let y = size * s1 * s1 * dot(axes[1], noise);
        let z = size * s2 * s2 * dot(axes[2], noise);
        let mut k = 0;
        while k < 3 {
            let at_k = k as usize;
            let moved = x * axes[0][at_k] + y * axes[1][at_k] + z * axes[2][at_k];
            *at_mut(parameters, (POSITION + k) * n + j) += moved;
            k += 1;
        }
    }
}

/// One invocation per splat that is trained.
#[spirv(compute(threads(256)))]
pub fn train_step(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] training: &Training,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] counters: &Counters,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] slot_counters: &SlotCounters,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] records: &[Vec4],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] starts: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 6)] slots: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 7)] pairs: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 8)] parameters: &mut [f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 9)] first: &mut [f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 10)] second: &mut [f32],
) {
    let (n, j) = (training.trained, id.x);
    let fits = (counters.pairs_needed <= params.pair_capacity)
        & (slot_counters.slots <= training.slot_capacity)
        & (slot_counters.blocks <= training.slot_capacity / 256);
    if (j >= n) | !fits {
        return;
    }
    let shape = Shape::load(training, parameters, j);
    let own = Gradient::of(params, training, parameters, &shape, records, starts, slots, pairs, j);
    let rates = training.rates;
    let mut k = 0;
    while k < 3 {
        let (place, by) = ((POSITION + k) * n + j, own.position[k as usize]);
        step(training, parameters, first, second, place, rates[0], by);
        let (place, by) = ((LOG_SCALE + k) * n + j, own.log_scale[k as usize]);
        let pull = training.scale_pull * shape.scale[k as usize];
        step(training, parameters, first, second, place, rates[1], by + pull);
        k += 1;
    }
    let mut k = 0;
    while k < 4 {
        let place = (ROTATION + k) * n + j;
        step(training, parameters, first, second, place, rates[2], own.rotation[k as usize]);
        k += 1;
    }
    let pull = training.opacity_pull * shape.opacity * (1.0 - shape.opacity);
    step(training, parameters, first, second, OPACITY * n + j, rates[3], own.opacity + pull);
    let mut k = 0;
    while k < training.sh_trained {
        let rate = if k == 0 { rates[4] } else { rates[5] };
        let (place, b) = ((SH + 3 * k) * n + j, own.basis[k as usize]);
        step(training, parameters, first, second, place, rate, b * own.colour[0]);
        step(training, parameters, first, second, place + n, rate, b * own.colour[1]);
        step(training, parameters, first, second, place + 2 * n, rate, b * own.colour[2]);
        k += 1;
    }
    if training.noise > 0.0 {
        shake(training, parameters, n, j);
    }
}
