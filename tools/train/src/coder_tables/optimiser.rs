//! AdamW with one cycle of the learning rate (Loshchilov and Hutter 2019; Smith 2018).

use rayon::prelude::*;

use super::examples::Example;
use super::float_networks::{Bits, WEIGHTS, Weights, learn};
use nvsprior::random::Random;

const BATCH: usize = 4096;
/// Parts of a batch whose gradients are summed apart, then in order: the same sums with any number of threads.
const PARTS: usize = 8;
const PEAK_RATE: f32 = 3e-3;
const DECAY: f32 = 1e-3;
const MOMENTS: (f32, f32) = (0.9, 0.999);
/// Largest weight that the coder's 16 bits hold.
const LARGEST: f32 = 15.9;

/// Share of the learning rate's peak at a part of the training.
fn rate(part: f32) -> f32 {
    const WARM: f32 = 0.1;
    let cosine = |t: f32| 0.5 - 0.5 * (std::f32::consts::PI * t).cos();
    if part < WARM {
        0.04 + 0.96 * cosine(part / WARM)
    } else {
        1.0 - cosine((part - WARM) / (1.0 - WARM))
    }
}

/// Fits weights to examples. Bits of all examples, by the weights as they went.
pub fn fit(weights: &mut Weights, examples: &[Example], epochs: usize, random: &mut Random) -> f64 {
    let mut order: Vec<u32> = (0..examples.len() as u32).collect();
    let batches = examples.len().div_ceil(BATCH).max(1);
    let mut moments = (vec![0.0f32; WEIGHTS], vec![0.0f32; WEIGHTS]);
    let (mut done, mut last) = (0, 0.0);
    for _ in 0..epochs {
        shuffle(&mut order, random);
        let mut bits = Bits::default();
        for batch in order.chunks(BATCH) {
            let (gradient, batch_bits) = gradient(weights, examples, batch);
            bits.add(&batch_bits);
            done += 1;
            let rate = PEAK_RATE * rate(done as f32 / (batches * epochs) as f32);
            step(weights, &gradient, batch.len(), done, rate, &mut moments);
        }
        last = bits.all();
    }
    last
}

fn shuffle(order: &mut [u32], random: &mut Random) {
    for i in (1..order.len()).rev() {
        order.swap(i, (random.bits() % (i as u64 + 1)) as usize);
    }
}

fn gradient(weights: &[f32], examples: &[Example], batch: &[u32]) -> (Vec<f32>, Bits) {
    let parts: Vec<_> = batch
        .par_chunks(batch.len().div_ceil(PARTS).max(1))
        .map(|part| {
            let mut gradient = vec![0.0; WEIGHTS];
            let mut bits = Bits::default();
            for index in part {
                bits.add(&learn(weights, &examples[*index as usize], Some(&mut gradient)));
            }
            (gradient, bits)
        })
        .collect();
    let mut sum = (vec![0.0; WEIGHTS], Bits::default());
    for (gradient, bits) in parts {
        sum.0.iter_mut().zip(gradient).for_each(|(sum, value)| *sum += value);
        sum.1.add(&bits);
    }
    sum
}

fn step(
    weights: &mut [f32],
    gradient: &[f32],
    batch: usize,
    count: usize,
    rate: f32,
    moments: &mut (Vec<f32>, Vec<f32>),
) {
    let unbiased = |moment: f32| 1.0 - moment.powi(count as i32);
    let (first, second) = (unbiased(MOMENTS.0), unbiased(MOMENTS.1));
    let moments = moments.0.iter_mut().zip(&mut moments.1);
    for ((weight, gradient), (m, v)) in weights.iter_mut().zip(gradient).zip(moments) {
        let gradient = gradient / batch as f32;
        *m = MOMENTS.0 * *m + (1.0 - MOMENTS.0) * gradient;
        *v = MOMENTS.1 * *v + (1.0 - MOMENTS.1) * gradient * gradient;
        let change = (*m / first) / ((*v / second).sqrt() + 1e-8) + DECAY * *weight;
        *weight = (*weight - rate * change).clamp(-LARGEST, LARGEST);
    }
}
