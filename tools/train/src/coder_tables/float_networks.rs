//! The coder's networks in floats: their loss and its gradient.

use nvsprior::coder_tables::Tables;
use nvsprior::coder_tables::networks::{
    CLASSES, COUNT_INPUTS, FEATURE_SCALE, HIDDEN, HIDDEN_2, HIDDEN_QUIET, HIDDEN_SIGN, LOGITS,
    MAGNITUDE_INPUTS, Networks, QUIET_INPUTS, SIGN_INPUTS, WEIGHT_SCALE, classes,
};
use nvsprior::residual::wavelet::training::UNARY;

use super::examples::Example;

/// Weights, in the order of [`Networks`].
pub type Weights = Vec<f32>;

/// Where each layer's weights begin.
mod layout {
    use super::*;

    pub const M1: usize = 0;
    pub const MC: usize = M1 + MAGNITUDE_INPUTS * HIDDEN;
    pub const MB1: usize = MC + CLASSES * HIDDEN;
    pub const M2: usize = MB1 + HIDDEN;
    pub const MB2: usize = M2 + HIDDEN * HIDDEN_2;
    pub const M3: usize = MB2 + HIDDEN_2;
    pub const MB3: usize = M3 + HIDDEN_2 * LOGITS;
    pub const Q1: usize = MB3 + LOGITS;
    pub const QC: usize = Q1 + QUIET_INPUTS * HIDDEN_QUIET;
    pub const QB1: usize = QC + CLASSES * HIDDEN_QUIET;
    pub const Q2: usize = QB1 + HIDDEN_QUIET;
    pub const QB2: usize = Q2 + HIDDEN_QUIET;
    pub const S1: usize = QB2 + 1;
    pub const SC: usize = S1 + SIGN_INPUTS * HIDDEN_SIGN;
    pub const SB1: usize = SC + CLASSES * HIDDEN_SIGN;
    pub const S2: usize = SB1 + HIDDEN_SIGN;
    pub const SB2: usize = S2 + HIDDEN_SIGN;
    pub const ALL: usize = SB2 + 1;
}
use layout::*;

pub const WEIGHTS: usize = ALL;

const _: () = assert!(WEIGHTS * 2 == size_of::<Networks>());

/// Weights to begin with: small and random, by the number of a layer's inputs.
pub fn random_weights(mut uniform: impl FnMut() -> f32) -> Weights {
    let mut weights = vec![0.0; WEIGHTS];
    let inputs = |n: usize| 1.0 / (n as f32).sqrt();
    let all = MAGNITUDE_INPUTS + CLASSES;
    let layers = [
        (M1..M2, inputs(all)),
        (M2..M3, inputs(HIDDEN)),
        (M3..Q1, inputs(HIDDEN_2)),
        (Q1..Q2, inputs(QUIET_INPUTS + CLASSES)),
        (Q2..S1, inputs(HIDDEN_QUIET)),
        (S1..S2, inputs(SIGN_INPUTS + CLASSES)),
        (S2..ALL, inputs(HIDDEN_SIGN)),
    ];
    for (range, bound) in layers {
        weights[range].fill_with(|| (2.0 * uniform() - 1.0) * bound);
    }
    weights
}

/// As the coder has them.
pub fn quantise(weights: &Weights, tables: &mut Tables) {
    let mut weights = weights.iter();
    tables.for_each_weight(|to| {
        let weight = weights.next().map_or(0.0, |w| f64::from(*w) * WEIGHT_SCALE);
        *to = weight.round().clamp(-32_767.0, 32_767.0) as i16;
    });
}

/// Bits of all examples, and of those: whether not zero, size, sign.
#[derive(Clone, Copy, Debug, Default)]
pub struct Bits {
    pub zero: f64,
    pub size: f64,
    pub sign: f64,
}

impl Bits {
    pub fn all(&self) -> f64 {
        self.zero + self.size + self.sign
    }

    pub fn add(&mut self, other: &Bits) {
        self.zero += other.zero;
        self.size += other.size;
        self.sign += other.sign;
    }
}

/// Nats of a bit and their derivative by the logit.
fn loss(logit: f32, bit: bool) -> (f32, f32) {
    let signed = if bit { -logit } else { logit };
    let nats = signed.max(0.0) + (-signed.abs()).exp().ln_1p();
    let chance = 1.0 / (1.0 + (-logit).exp());
    (nats, chance - f32::from(u8::from(bit)))
}

fn add_scaled<const N: usize>(sums: &mut [f32; N], weights: &[f32], value: f32) {
    for (sum, weight) in sums.iter_mut().zip(weights) {
        *sum += weight * value;
    }
}

fn row<const N: usize>(weights: &[f32], start: usize, index: usize) -> &[f32] {
    &weights[start + index * N..start + (index + 1) * N]
}

fn first<const N: usize>(weights: &[f32], bias: usize) -> [f32; N] {
    std::array::from_fn(|i| weights[bias + i])
}

/// Adds an example's bits, and the gradient of its nats.
pub fn learn(weights: &[f32], example: &Example, gradient: Option<&mut [f32]>) -> Bits {
    let band = example.band.map(usize::from);
    let band = classes(band[0], band[1], band[2]);
    let mut gradient = gradient;
    let is_quiet = example.magnitude[..COUNT_INPUTS].iter().all(|count| *count == 0);
    let mut bits = Bits::default();
    if is_quiet {
        let inputs: [i16; QUIET_INPUTS] =
            std::array::from_fn(|i| example.magnitude[COUNT_INPUTS + i]);
        let target = (example.value != 0, example.weight, example.share);
        let gradient = gradient.as_deref_mut();
        bits.zero = learn_small::<_, HIDDEN_QUIET>(&QUIET, weights, inputs, band, target, gradient);
    }
    if !is_quiet || example.value != 0 {
        bits.add(&learn_magnitude(weights, example, band, is_quiet, gradient.as_deref_mut()));
    }
    if example.value != 0 {
        let target = (example.value < 0, 1.0, example.share);
        bits.sign =
            learn_small::<_, HIDDEN_SIGN>(&SIGN, weights, example.sign, band, target, gradient);
    }
    bits
}

fn learn_magnitude(
    weights: &[f32],
    example: &Example,
    band: [usize; 3],
    is_quiet: bool,
    gradient: Option<&mut [f32]>,
) -> Bits {
    let inputs = example.magnitude.map(|v| f32::from(v) / FEATURE_SCALE as f32);
    let mut a: [f32; HIDDEN] = first(weights, MB1);
    for class in band {
        add_scaled(&mut a, row::<HIDDEN>(weights, MC, class), 1.0);
    }
    for (i, input) in inputs.iter().enumerate() {
        add_scaled(&mut a, row::<HIDDEN>(weights, M1, i), *input);
    }
    let ha = a.map(|v| v.max(0.0));
    let mut b: [f32; HIDDEN_2] = first(weights, MB2);
    for (i, input) in ha.iter().enumerate() {
        add_scaled(&mut b, row::<HIDDEN_2>(weights, M2, i), *input);
    }
    let hb = b.map(|v| v.max(0.0));
    let mut z: [f32; LOGITS] = first(weights, MB3);
    for (i, input) in hb.iter().enumerate() {
        add_scaled(&mut z, row::<LOGITS>(weights, M3, i), *input);
    }
    let (bits, dz) = magnitude_loss(&z, example, is_quiet);
    let dz = dz.map(|slope| slope * example.share);
    if let Some(g) = gradient {
        let mut db = [0.0; HIDDEN_2];
        for (i, hidden) in hb.iter().enumerate() {
            let weights = row::<LOGITS>(weights, M3, i);
            for k in 0..LOGITS {
                g[M3 + i * LOGITS + k] += hidden * dz[k];
                db[i] += weights[k] * dz[k];
            }
            db[i] = if b[i] > 0.0 { db[i] } else { 0.0 };
        }
        let mut da = [0.0; HIDDEN];
        for (i, hidden) in ha.iter().enumerate() {
            let weights = row::<HIDDEN_2>(weights, M2, i);
            let g = &mut g[M2 + i * HIDDEN_2..M2 + (i + 1) * HIDDEN_2];
            for k in 0..HIDDEN_2 {
                g[k] += hidden * db[k];
                da[i] += weights[k] * db[k];
            }
            da[i] = if a[i] > 0.0 { da[i] } else { 0.0 };
        }
        let mut add = |start: usize, values: &[f32], scale: f32| {
            for (g, value) in g[start..].iter_mut().zip(values) {
                *g += value * scale;
            }
        };
        for (i, input) in inputs.iter().enumerate() {
            if *input != 0.0 {
                add(M1 + i * HIDDEN, &da, *input);
            }
        }
        for class in band {
            add(MC + class * HIDDEN, &da, 1.0);
        }
        add(MB1, &da, 1.0);
        add(MB2, &db, 1.0);
        add(MB3, &dz, 1.0);
    }
    bits
}

/// Bits of a magnitude, and the derivatives of its nats by the logits. In a quiet context another network tells
/// whether it is zero.
fn magnitude_loss(z: &[f32; LOGITS], example: &Example, is_quiet: bool) -> (Bits, [f32; LOGITS]) {
    let magnitude = i32::from(example.value).abs();
    let mut dz = [0.0; LOGITS];
    let mut bits = Bits::default();
    let mut take = |k: usize, bit: bool, times: f32, to: &mut f64| {
        let (nats, slope) = loss(z[k], bit);
        *to += f64::from(nats * times) / std::f64::consts::LN_2;
        dz[k] += slope * times;
    };
    if !is_quiet {
        take(0, magnitude > 0, example.weight, &mut bits.zero);
    }
    for k in 1..magnitude.min(3) {
        take(k as usize, true, 1.0, &mut bits.size);
    }
    if (1..3).contains(&magnitude) {
        take(magnitude as usize, false, 1.0, &mut bits.size);
    }
    if magnitude >= 3 {
        take(3, true, (magnitude.min(UNARY) - 3) as f32, &mut bits.size);
        take(3, false, if magnitude < UNARY { 1.0 } else { 0.0 }, &mut bits.size);
    }
    (bits, dz)
}

/// A network of one hidden layer and one logit: where its weights begin.
struct Small {
    rows: usize,
    classes: usize,
    bias_1: usize,
    output: usize,
    bias_2: usize,
}

const SIGN: Small = Small { rows: S1, classes: SC, bias_1: SB1, output: S2, bias_2: SB2 };
const QUIET: Small = Small { rows: Q1, classes: QC, bias_1: QB1, output: Q2, bias_2: QB2 };

/// Bits that a small network gives a bit. `weight`: how many examples this one stands for; `share`: what they count.
fn learn_small<const INPUTS: usize, const WIDTH: usize>(
    net: &Small,
    weights: &[f32],
    inputs: [i16; INPUTS],
    band: [usize; 3],
    (bit, weight, share): (bool, f32, f32),
    gradient: Option<&mut [f32]>,
) -> f64 {
    let inputs = inputs.map(|v| f32::from(v) / FEATURE_SCALE as f32);
    let mut a: [f32; WIDTH] = first(weights, net.bias_1);
    for class in band {
        add_scaled(&mut a, row::<WIDTH>(weights, net.classes, class), 1.0);
    }
    for (i, input) in inputs.iter().enumerate() {
        add_scaled(&mut a, row::<WIDTH>(weights, net.rows, i), *input);
    }
    let ha = a.map(|v| v.max(0.0));
    let products: f32 = (0..WIDTH).map(|i| ha[i] * weights[net.output + i]).sum();
    let (nats, slope) = loss(weights[net.bias_2] + products, bit);
    let dz = slope * weight * share;
    if let Some(g) = gradient {
        let mut da = [0.0; WIDTH];
        for i in 0..WIDTH {
            g[net.output + i] += ha[i] * dz;
            da[i] = if a[i] > 0.0 { weights[net.output + i] * dz } else { 0.0 };
        }
        g[net.bias_2] += dz;
        let mut add = |start: usize, scale: f32| {
            for (g, value) in g[start..].iter_mut().zip(&da) {
                *g += value * scale;
            }
        };
        for (i, input) in inputs.iter().enumerate() {
            if *input != 0.0 {
                add(net.rows + i * WIDTH, *input);
            }
        }
        for class in band {
            add(net.classes + class * WIDTH, 1.0);
        }
        add(net.bias_1, 1.0);
    }
    f64::from(nats * weight) / std::f64::consts::LN_2
}

pub fn weights_of(tables: &Tables) -> Weights {
    let mut weights = Vec::with_capacity(WEIGHTS);
    tables.clone().for_each_weight(|weight| {
        weights.push((f64::from(*weight) / WEIGHT_SCALE) as f32);
    });
    weights
}
