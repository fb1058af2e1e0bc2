//! What the tables say of a coefficient: chances of its bits, their costs, and its value.

use super::fixed::FEATURE_PLACES;
use super::frame::Frame;
use super::network::{
    COUNT_INPUTS, HIDDEN, HIDDEN_2, HIDDEN_QUIET, HIDDEN_SIGN, LARGEST_HIDDEN, LARGEST_LOGIT,
    LOGIT_PLACES, LOGITS, Logit, MAGNITUDE_INPUTS, Networks, QUIET_INPUTS, SIGN_INPUTS,
    WEIGHT_PLACES,
};
use super::range_coder::Probability;
use super::tables::{Offsets, Tables};

/// Rows of weights in pairs, one pair per output: processors multiply and add two at a time.
#[derive(Clone)]
struct Layer<const PAIRS: usize, const OUTPUTS: usize>(Box<[[[i16; 2]; OUTPUTS]; PAIRS]>);

impl<const PAIRS: usize, const OUTPUTS: usize> Layer<PAIRS, OUTPUTS> {
    fn new(rows: &[[i16; OUTPUTS]]) -> Layer<PAIRS, OUTPUTS> {
        let mut pairs = Box::new([[[0; 2]; OUTPUTS]; PAIRS]);
        for (i, row) in rows.iter().enumerate() {
            for (to, weight) in pairs[i / 2].iter_mut().zip(row) {
                to[i % 2] = *weight;
            }
        }
        Layer(pairs)
    }

    /// Adds the products to the sums.
    fn add(&self, sums: &mut [i32; OUTPUTS], inputs: &[[i16; 2]; PAIRS]) {
        for (weights, &[a, b]) in self.0.iter().zip(inputs) {
            // Most contexts are empty.
            if (a, b) != (0, 0) {
                for (sum, weights) in sums.iter_mut().zip(weights) {
                    *sum +=
                        i32::from(weights[0]) * i32::from(a) + i32::from(weights[1]) * i32::from(b);
                }
            }
        }
    }
}

const fn pairs(count: usize) -> usize {
    count.div_ceil(2)
}

/// Inputs of the network for magnitudes, in pairs; one is left over.
pub type MagnitudeInputs = [[i16; 2]; pairs(MAGNITUDE_INPUTS)];
/// Of the one for signs.
pub type SignInputs = [[i16; 2]; pairs(SIGN_INPUTS)];

/// A band's share of the first layers.
#[derive(Clone, Copy)]
pub struct BandBias {
    magnitude: [i32; HIDDEN],
    quiet: [i32; HIDDEN_QUIET],
    sign: [i32; HIDDEN_SIGN],
}

/// A hidden value of a sum.
fn hidden(sum: i32) -> i16 {
    (sum >> WEIGHT_PLACES).clamp(0, LARGEST_HIDDEN) as i16
}

/// The hidden values of sums, in pairs.
fn hidden_pairs<const SUMS: usize, const PAIRS: usize>(sums: &[i32; SUMS]) -> [[i16; 2]; PAIRS] {
    let mut values = [[0; 2]; PAIRS];
    for (to, sum) in values.as_flattened_mut().iter_mut().zip(sums) {
        *to = hidden(*sum);
    }
    values
}

fn logit(sum: i32) -> Logit {
    let places = WEIGHT_PLACES + FEATURE_PLACES - LOGIT_PLACES;
    (sum >> places).clamp(-LARGEST_LOGIT, LARGEST_LOGIT) as Logit
}

fn biases<const N: usize>(bias: &[i16; N]) -> [i32; N] {
    bias.map(|b| i32::from(b) << FEATURE_PLACES)
}

/// Tables, ready for use.
pub struct Predictor {
    networks: Networks,
    magnitude_1: Layer<{ pairs(MAGNITUDE_INPUTS) }, HIDDEN>,
    magnitude_2: Layer<{ pairs(HIDDEN) }, HIDDEN_2>,
    magnitude_3: Layer<{ pairs(HIDDEN_2) }, LOGITS>,
    quiet_1: Layer<{ pairs(QUIET_INPUTS) }, HIDDEN_QUIET>,
    sign_1: Layer<{ pairs(SIGN_INPUTS) }, HIDDEN_SIGN>,
    /// Where coefficients lie in their intervals.
    pub offsets: Offsets,
    /// Chances of logits.
    pub chances: Chances,
}

/// One for each kind of frame.
pub struct Predictors {
    alone: Predictor,
    /// Of frames that lean on a reference. Boxed, so that what holds it stays small.
    pub leaning: Box<Predictor>,
}

impl Predictors {
    /// Of the tables of frames that stand alone, and of those that lean.
    pub fn new(alone: &Tables, leaning: &Tables) -> Predictors {
        Predictors { alone: Predictor::new(alone), leaning: Box::new(Predictor::new(leaning)) }
    }

    /// The one of a frame.
    pub fn of(&self, frame: &Frame) -> &Predictor {
        if frame.leans { &self.leaning } else { &self.alone }
    }
}

impl Predictor {
    /// Of tables.
    pub fn new(tables: &Tables) -> Predictor {
        let networks = tables.networks.clone();
        Predictor {
            magnitude_1: Layer::new(&networks.magnitude_1),
            magnitude_2: Layer::new(&networks.magnitude_2),
            magnitude_3: Layer::new(&networks.magnitude_3),
            quiet_1: Layer::new(&networks.quiet_1),
            sign_1: Layer::new(&networks.sign_1),
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

    /// Logits of a magnitude.
    pub fn magnitude(&self, band: &BandBias, inputs: &MagnitudeInputs) -> [Logit; LOGITS] {
        let mut first = band.magnitude;
        self.magnitude_1.add(&mut first, inputs);
        let mut second = biases(&self.networks.magnitude_bias_2);
        self.magnitude_2.add(&mut second, &hidden_pairs(&first));
        let mut third = biases(&self.networks.magnitude_bias_3);
        self.magnitude_3.add(&mut third, &hidden_pairs(&second));
        third.map(logit)
    }

    /// Logit of a coefficient that is not zero, in a quiet context.
    pub fn quiet(&self, band: &BandBias, inputs: &MagnitudeInputs) -> Logit {
        let mut first = band.quiet;
        // Both kinds of inputs are even in number but for the last, so that pairs stay pairs.
        const QUIET: usize = COUNT_INPUTS / 2;
        let inputs = std::array::from_fn(|i| inputs[QUIET + i]);
        self.quiet_1.add(&mut first, &inputs);
        output(&first, &self.networks.quiet_2, self.networks.quiet_bias_2)
    }

    /// Logit of a minus sign.
    pub fn sign(&self, band: &BandBias, inputs: &SignInputs) -> Logit {
        let mut first = band.sign;
        self.sign_1.add(&mut first, inputs);
        output(&first, &self.networks.sign_2, self.networks.sign_bias_2)
    }
}

/// The logit of a hidden layer's sums.
fn output<const N: usize>(sums: &[i32; N], weights: &[i16; N], bias: i16) -> Logit {
    let bias = i32::from(bias) << FEATURE_PLACES;
    let products = weights.iter().zip(sums);
    logit(products.fold(bias, |sum, (w, v)| sum + i32::from(*w) * i32::from(hidden(*v))))
}

const _: () = assert!(COUNT_INPUTS.is_multiple_of(2));

fn add<const N: usize>(sums: &mut [i32; N], values: &[i32; N]) {
    for (sum, value) in sums.iter_mut().zip(values) {
        *sum += value;
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

    /// What a bit costs, bits.
    pub fn cost(&self, logit: Logit, bit: bool) -> f32 {
        let logit = i32::from(logit);
        self.cost[((if bit { logit } else { -logit }) + LARGEST_LOGIT) as usize]
    }
}
