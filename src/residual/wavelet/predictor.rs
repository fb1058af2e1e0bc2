//! What the tables say of a coefficient: chances of its bits, their costs, and its value.

use wide::{i16x8, i32x4};

use super::frame::Frame;
use crate::coder_tables::networks::FEATURE_PLACES;
use crate::coder_tables::networks::{
    COUNT_INPUTS, HIDDEN, HIDDEN_2, HIDDEN_QUIET, HIDDEN_SIGN, LARGEST_HIDDEN, LARGEST_LOGIT,
    LOGIT_PLACES, LOGITS, Logit, MAGNITUDE_INPUTS, Networks, QUIET_INPUTS, SIGN_INPUTS,
    WEIGHT_PLACES,
};
use crate::coder_tables::{Offsets, Tables};
use crate::range_coder::Probability;

/// Weights of four outputs in pairs: processors multiply and add two at a time.
#[derive(Clone)]
struct Layer<const PAIRS: usize, const FOURS: usize>(Box<[[i16x8; FOURS]; PAIRS]>);

impl<const PAIRS: usize, const FOURS: usize> Layer<PAIRS, FOURS> {
    fn new<const OUTPUTS: usize>(rows: &[[i16; OUTPUTS]]) -> Layer<PAIRS, FOURS> {
        const { assert!(OUTPUTS == 4 * FOURS) };
        let weight = |pair: usize, i: usize, output: usize| {
            rows.get(2 * pair + i).map_or(0, |row| row[output])
        };
        let four = |pair: usize, four: usize| {
            i16x8::new(std::array::from_fn(|i| weight(pair, i % 2, 4 * four + i / 2)))
        };
        let fours = |pair: usize| std::array::from_fn(|f| four(pair, f));
        Layer(Box::new(std::array::from_fn(fours)))
    }

    /// Adds the products to the sums.
    fn add(&self, sums: &mut [i32x4; FOURS], inputs: &[[i16; 2]]) {
        for (weights, [a, b]) in self.0.iter().zip(inputs) {
            let inputs = i16x8::new([*a, *b, *a, *b, *a, *b, *a, *b]);
            for (sum, weights) in sums.iter_mut().zip(weights) {
                *sum += weights.dot(inputs);
            }
        }
    }
}

const fn pairs(count: usize) -> usize {
    count.div_ceil(2)
}

/// Inputs of the network for magnitudes, in pairs; one is left over.
pub type MagnitudeInputs = [[i16; 2]; pairs(MAGNITUDE_INPUTS)];
/// Inputs of the network for signs, in pairs.
pub type SignInputs = [[i16; 2]; pairs(SIGN_INPUTS)];

/// Inputs of the network for quiet contexts, in pairs.
pub type QuietInputs = [[i16; 2]; pairs(QUIET_INPUTS)];

/// A band's share of the first layers.
#[derive(Clone, Copy)]
pub struct BandBias {
    magnitude: [i32x4; HIDDEN / 4],
    quiet: [i32x4; HIDDEN_QUIET / 4],
    sign: [i32x4; HIDDEN_SIGN / 4],
}

/// The hidden values of sums.
fn hidden<const FOURS: usize, const EIGHTS: usize>(sums: &[i32x4; FOURS]) -> [i16x8; EIGHTS] {
    const { assert!(EIGHTS == FOURS.div_ceil(2) && LARGEST_HIDDEN <= i16::MAX as i32) };
    std::array::from_fn(|i| {
        let four = |i: usize| sums.get(i).map_or(i32x4::ZERO, |sum| *sum >> WEIGHT_PLACES);
        let sums = i16x8::from_i32x8_saturate(bytemuck::cast([four(2 * i), four(2 * i + 1)]));
        sums.max(i16x8::ZERO).min(i16x8::splat(LARGEST_HIDDEN as i16))
    })
}

/// Weights of hidden values for one output.
fn eights<const N: usize, const EIGHTS: usize>(weights: &[i16; N]) -> [i16x8; EIGHTS] {
    const { assert!(EIGHTS == N.div_ceil(8)) };
    let weight = |i: usize| weights.get(i).copied().unwrap_or(0);
    std::array::from_fn(|eight| i16x8::new(std::array::from_fn(|i| weight(8 * eight + i))))
}

fn logit(sum: i32) -> Logit {
    let places = WEIGHT_PLACES + FEATURE_PLACES - LOGIT_PLACES;
    (sum >> places).clamp(-LARGEST_LOGIT, LARGEST_LOGIT) as Logit
}

fn biases<const N: usize, const FOURS: usize>(bias: &[i16; N]) -> [i32x4; FOURS] {
    const { assert!(N == 4 * FOURS) };
    std::array::from_fn(|four| {
        let of = |i: usize| i32::from(bias[4 * four + i]) << FEATURE_PLACES;
        i32x4::new(std::array::from_fn(of))
    })
}

pub struct Predictor {
    networks: Networks,
    magnitude_1: Layer<{ pairs(MAGNITUDE_INPUTS) }, { HIDDEN / 4 }>,
    magnitude_bias_2: [i32x4; HIDDEN_2 / 4],
    magnitude_2: Layer<{ HIDDEN / 2 }, { HIDDEN_2 / 4 }>,
    magnitude_bias_3: [i32x4; LOGITS / 4],
    magnitude_3: Layer<{ HIDDEN_2 / 2 }, { LOGITS / 4 }>,
    quiet_1: Layer<{ pairs(QUIET_INPUTS) }, { HIDDEN_QUIET / 4 }>,
    quiet_2: [i16x8; HIDDEN_QUIET.div_ceil(8)],
    sign_1: Layer<{ pairs(SIGN_INPUTS) }, { HIDDEN_SIGN / 4 }>,
    sign_2: [i16x8; HIDDEN_SIGN / 8],
    /// Where coefficients lie in their intervals.
    pub offsets: Offsets,
    pub chances: Chances,
}

/// A predictor for each kind of frame.
pub struct Predictors {
    intra: Predictor,
    /// The predictor of frames with small or displaced blocks, if it is another one.
    small_blocks: Option<Box<Predictor>>,
    /// The predictor of inter frames. Boxed, so that what holds it stays small.
    pub inter: Box<Predictor>,
}

impl Predictors {
    /// Makes them of the tables of intra frames and those of inter frames.
    pub fn new(intra: &Tables, inter: &Tables) -> Predictors {
        // A prior's tables have learnt from small blocks, too.
        let small_blocks = (*intra == Tables::generic()).then(Tables::small_blocks);
        Predictors {
            intra: Predictor::new(intra),
            small_blocks: small_blocks.map(|tables| Box::new(Predictor::new(&tables))),
            inter: Box::new(Predictor::new(inter)),
        }
    }

    pub fn of(&self, frame: &Frame) -> &Predictor {
        if frame.inter_seen().is_some() {
            return &self.inter;
        }
        let small_blocks = frame.small_blocks.in_use || frame.has_displaced();
        self.small_blocks.as_deref().filter(|_| small_blocks).unwrap_or(&self.intra)
    }
}

impl Predictor {
    pub fn new(tables: &Tables) -> Predictor {
        let networks = tables.networks.clone();
        Predictor {
            magnitude_1: Layer::new(&networks.magnitude_1),
            magnitude_bias_2: biases(&networks.magnitude_bias_2),
            magnitude_bias_3: biases(&networks.magnitude_bias_3),
            magnitude_2: Layer::new(&networks.magnitude_2),
            magnitude_3: Layer::new(&networks.magnitude_3),
            quiet_1: Layer::new(&networks.quiet_1),
            quiet_2: eights(&networks.quiet_2),
            sign_1: Layer::new(&networks.sign_1),
            sign_2: eights(&networks.sign_2),
            networks,
            offsets: tables.offsets,
            chances: Chances::new(),
        }
    }

    /// What the bands of three classes have in common.
    pub fn band_bias(&self, classes: [usize; 3]) -> BandBias {
        let networks = &self.networks;
        let mut magnitude = biases(&networks.magnitude_bias_1);
        let mut quiet = biases(&networks.quiet_bias_1);
        let mut sign = biases(&networks.sign_bias_1);
        for class in classes {
            add(&mut magnitude, &biases(&networks.magnitude_class[class]));
            add(&mut quiet, &biases(&networks.quiet_class[class]));
            add(&mut sign, &biases(&networks.sign_class[class]));
        }
        BandBias { magnitude, quiet, sign }
    }

    pub fn magnitude(&self, band: &BandBias, inputs: &MagnitudeInputs) -> [Logit; LOGITS] {
        let mut first = band.magnitude;
        self.magnitude_1.add(&mut first, inputs);
        let mut second = self.magnitude_bias_2;
        let hidden_1: [i16x8; HIDDEN / 8] = hidden(&first);
        self.magnitude_2.add(&mut second, bytemuck::cast_slice(&hidden_1));
        let mut third = self.magnitude_bias_3;
        let hidden_2: [i16x8; HIDDEN_2 / 8] = hidden(&second);
        self.magnitude_3.add(&mut third, bytemuck::cast_slice(&hidden_2));
        let [logits] = third;
        logits.to_array().map(logit)
    }

    /// Logit of a coefficient that is not zero, in a quiet context.
    pub fn quiet(&self, band: &BandBias, inputs: &QuietInputs) -> Logit {
        let mut first = band.quiet;
        self.quiet_1.add(&mut first, inputs);
        output(hidden(&first), &self.quiet_2, self.networks.quiet_bias_2)
    }

    /// Logit of a minus sign.
    pub fn sign(&self, band: &BandBias, inputs: &SignInputs) -> Logit {
        let mut first = band.sign;
        self.sign_1.add(&mut first, inputs);
        output(hidden(&first), &self.sign_2, self.networks.sign_bias_2)
    }
}

/// The logit of a hidden layer's values.
fn output<const EIGHTS: usize>(
    hidden: [i16x8; EIGHTS],
    weights: &[i16x8; EIGHTS],
    bias: i16,
) -> Logit {
    let products = hidden.iter().zip(weights).map(|(hidden, weights)| hidden.dot(*weights));
    let sum = products.fold(i32x4::ZERO, |sum, products| sum + products).reduce_add();
    logit((i32::from(bias) << FEATURE_PLACES) + sum)
}

const _: () = assert!(COUNT_INPUTS.is_multiple_of(2));

fn add<const N: usize>(sums: &mut [i32x4; N], values: &[i32x4; N]) {
    for (sum, value) in sums.iter_mut().zip(values) {
        *sum += *value;
    }
}

/// Chances and costs of logits.
pub struct Chances {
    one: Vec<Probability>,
    /// Bits of a one.
    cost: Vec<f32>,
}

impl Chances {
    /// The same numbers on every processor: exp and log2 are computed in software.
    pub fn new() -> Chances {
        let chance = |logit: i32| {
            let value = f64::from(logit) / f64::from(1 << LOGIT_PLACES);
            (65_536.0 / (1.0 + libm::exp(-value))).clamp(2.0, 65_534.0) as Probability
        };
        let one: Vec<_> = (-LARGEST_LOGIT..=LARGEST_LOGIT).map(chance).collect();
        let bits = |one: &Probability| -libm::log2(f64::from(*one) / 65_536.0) as f32;
        let cost = one.iter().map(bits).collect();
        Chances { one, cost }
    }

    /// Chance of a one.
    pub fn one(&self, logit: Logit) -> Probability {
        self.one[(i32::from(logit) + LARGEST_LOGIT) as usize]
    }

    pub fn cost(&self, logit: Logit, bit: bool) -> f32 {
        let logit = i32::from(logit);
        self.cost[((if bit { logit } else { -logit }) + LARGEST_LOGIT) as usize]
    }
}
