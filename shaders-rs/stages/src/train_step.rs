//! Stage `train_step`: the loss's gradient by all parameters, and one step of them along it (Adam, Kingma and Ba 2015),
//! with the pulls and the noise of 3DGS-MCMC (Kheradmand et al. 2024). Nothing is done if the pairs or the slots did
//! not fit: the host makes room and runs the step again.

use crate::memory::{PairsMut, at};
use crate::shared::{Counters, Params, dot, sh_coefficients};
use crate::splat_gradient::Gradient;
use crate::train_activate::{Shape, Trained, coefficients, harmonic, put_triple};
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

/// One step of the parameter at a place, along its gradient. `value`: the parameter before. Returns it as it is then.
fn step<M: PairsMut + ?Sized>(
    training: &Training,
    moments: &mut M,
    place: u32,
    value: f32,
    rate: f32,
    gradient: f32,
) -> f32 {
    let [mean, square] = moments.pair(place);
    let mean = mean + (1.0 - FADING[0]) * (gradient - mean);
    let square = square + (1.0 - FADING[1]) * (gradient * gradient - square);
    moments.put(place, [mean, square]);
    let spread = (square * training.unbias[1]).sqrt() + EPSILON;
    value - rate * (mean * training.unbias[0]) / spread
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

/// How far a faint splat's position is moved, by noise of its own covariance.
fn noise(training: &Training, shape: &Shape, j: u32) -> [f32; 3] {
    let faint = 1.0 / (1.0 + (SHARPNESS * (shape.opacity - FAINT)).exp());
    let size = training.noise * faint;
    let seed = mixed(training.step ^ mixed(j));
    let ([a, b], [c, _]) = (normal(seed), normal(seed ^ 0x9e37_79b9));
    let [u, v, w] = shape.unit_axes();
    let [s0, s1, s2] = shape.scale;
    let noise = [a, b, c];
    let x = size * s0 * s0 * dot(u, noise);
    let y = size * s1 * s1 * dot(v, noise);
    let z = size * s2 * s2 * dot(w, noise);
    [x * u[0] + y * v[0] + z * w[0], x * u[1] + y * v[1] + z * w[1], x * u[2] + y * v[2] + z * w[2]]
}

/// Takes the step of the splat at place `j` of those that are trained.
fn take<M: PairsMut + ?Sized>(
    params: &Params,
    training: &Training,
    sh_degree: u32,
    records: &[Vec4],
    starts: &[u32],
    slots: &[u32],
    pairs: &M,
    parameters: &mut [f32],
    moments: &mut M,
    j: u32,
) {
    let (n, count) = (training.trained, sh_coefficients(sh_degree));
    let before = Trained::load(training, parameters, j);
    let shape = Shape::of(training, &before);
    let own =
        Gradient::of(params, training, &shape, parameters, count, records, starts, slots, pairs, j);
    let rates = training.rates;
    // Written out, as arrays would lie in memory.
    macro_rules! steps {
        ($first:expr, $before:expr, $rate:expr, $by:expr; $($k:literal)+) => {
            [$({
                let place = ($first + $k) * n + j;
                step(training, moments, place, $before[$k], $rate, $by[$k])
            }),+]
        };
    }
    let position = steps!(POSITION, before.position, rates[0], own.position; 0 1 2);
    let (by, scale) = (own.log_scale, shape.scale);
    let pull = training.scale_pull;
    let by = [by[0] + pull * scale[0], by[1] + pull * scale[1], by[2] + pull * scale[2]];
    let log_scale = steps!(LOG_SCALE, before.log_scale, rates[1], by; 0 1 2);
    let rotation = steps!(ROTATION, before.rotation, rates[2], own.rotation; 0 1 2 3);
    let pull = training.opacity_pull * shape.opacity * (1.0 - shape.opacity);
    let opacity = steps!(OPACITY, [before.opacity], rates[3], [own.opacity + pull]; 0)[0];
    let after = Trained { position, log_scale, rotation, opacity };
    let moved = noise(training, &Shape::of(training, &after), j);
    let moved = [position[0] + moved[0], position[1] + moved[1], position[2] + moved[2]];
    Trained { position: moved, ..after }.store(training, parameters, j);
    // Coefficient k.
    macro_rules! harmonic_step {
        ($k:expr) => {
            let (k, first) = ($k, SH + 3 * $k);
            let (b, by) = (own.basis[k as usize], own.colour);
            let before = harmonic(training, parameters, k, j);
            let rate = if k == 0 { rates[4] } else { rates[5] };
            let [r, g, b] = steps!(first, before, rate, [b * by[0], b * by[1], b * by[2]]; 0 1 2);
            put_triple(parameters, n, first, j, [r, g, b]);
        };
    }
    if M::WRITTEN_OUT {
        coefficients!(k => if k < count { harmonic_step!(k); });
    } else {
        let mut k = 0;
        while k < count {
            harmonic_step!(k);
            k += 1;
        }
    }
}

/// Makes a form of the stage: its entry point, and how pairs of floats are loaded. One invocation per splat of the list
/// that stage `train_slots` made.
macro_rules! form {
    ($name:ident, $pair:ty) => {
        /// Takes the steps of the splats in view.
        #[spirv(compute(threads(256)))]
        pub fn $name(
            #[spirv(global_invocation_id)] id: UVec3,
            #[spirv(spec_constant(id = 0, default = 3))] sh_degree: u32,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] training: &Training,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] counters: &Counters,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] slot_counters: &SlotCounters,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] seen: &[u32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] records: &[Vec4],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 6)] starts: &[u32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 7)] slots: &[u32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 8)] pairs: &[$pair],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 9)] parameters: &mut [f32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 10)] moments: &mut [$pair],
        ) {
            let fits = (counters.pairs_needed <= params.pair_capacity)
                & (slot_counters.slots <= training.slot_capacity)
                & (slot_counters.blocks <= training.slot_capacity / 256);
            if (id.x < slot_counters.seen) & fits {
                let j = at(seen, id.x);
                take(
                    params, training, sh_degree, records, starts, slots, pairs, parameters,
                    moments, j,
                );
            }
        }
    };
}

form!(train_step, f32);
form!(train_step_lockstep, u64);
