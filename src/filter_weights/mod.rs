//! The display filter's weights: a small convolutional network of whole numbers.
//!
//! The filter itself is [`render::filter`](crate::render::filter). The weights are a room of their own, since a prior
//! may bring weights of its scene.
//!
//! **The network.** A picture of 8-bit RGB is taken apart into blocks of 2×2 pixels. A block has 24 inputs: of each of
//! its pixels, row by row, the picture's R, G, B and the differences picture − render, each clamped to −128 … 127; all
//! plus 128. [`LAYERS`] convolutions of 3×3 taps follow, at the [`DILATIONS`]; a tap outside of the picture takes the
//! nearest block within. An output of a layer is `clamp(⌊(bias + Σ weight · input) / 2^shift⌋, 0, 255)`. The last layer
//! has 12 outputs: of each pixel the corrections of R, G, B, in quarters of a level, plus 128.
//!
//! **Exact in f32.** `255 Σ |weight| + |bias|` is below 2²⁴ for each output, so that no order of summing rounds.

use crc::{CRC_32_ISO_HDLC, Crc};

/// Convolutions, one after the other.
pub const LAYERS: usize = 7;
/// Distances of the taps of each layer, blocks.
pub const DILATIONS: [u32; LAYERS] = [1, 1, 2, 4, 2, 1, 1];
/// Inputs of the first layer.
pub const INPUTS: usize = 24;
/// Outputs of all layers but the last.
pub const CHANNELS: usize = 16;
/// Outputs of the last layer.
pub const OUTPUTS: usize = 12;
/// Taps of a convolution.
pub const TAPS: usize = 9;
/// Steps of a level that a correction is told in.
pub const FRACTION: i32 = 4;

/// First bytes of a file.
const MAGIC: [u8; 4] = *b"NVF1";
/// Sums must stay below it.
const EXACT: i64 = 1 << 24;
/// Greatest shift.
const SHIFTS: u8 = 20;

/// Why bytes are no weights.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs)] // Their texts tell.
pub enum FilterWeightsError {
    #[error("no filter weights: they begin with `NVF1`")]
    Magic,
    #[error("filter weights of {found} bytes, {expected} expected")]
    Length { expected: usize, found: usize },
    #[error("filter weights whose check does not match: they are damaged")]
    Check,
    #[error(
        "output {output} of layer {layer} of the filter may exceed 24 bits, or is shifted by more than {SHIFTS}"
    )]
    Range { layer: usize, output: usize },
}

/// A convolution.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Convolution {
    /// Weights: by output, input and tap, taps row by row.
    pub weights: Vec<i8>,
    /// By output: the bias for step number 0 of the quantiser, and what each number more adds.
    pub biases: Vec<[i32; 2]>,
    /// By output: what the sum is shifted by.
    pub shifts: Vec<u8>,
}

impl Convolution {
    /// Number of inputs of a layer.
    pub fn inputs(layer: usize) -> usize {
        if layer == 0 { INPUTS } else { CHANNELS }
    }

    /// Number of outputs of a layer.
    pub fn outputs(layer: usize) -> usize {
        if layer + 1 == LAYERS { OUTPUTS } else { CHANNELS }
    }

    /// The bias of an output, if the residual was quantised by step number `step`.
    pub fn bias(&self, output: usize, step: u8) -> i32 {
        let [at_zero, more] = self.biases[output];
        at_zero + more * i32::from(step)
    }

    /// Number of weights of an output of a layer.
    fn fan_in(layer: usize) -> usize {
        Convolution::inputs(layer) * TAPS
    }

    /// Whether an output's sums stay exact, whatever comes in.
    fn is_exact(&self, layer: usize, output: usize) -> bool {
        let fan_in = Convolution::fan_in(layer);
        let weights = &self.weights[output * fan_in..(output + 1) * fan_in];
        let sum: i64 = weights.iter().map(|weight| 255 * i64::from(*weight).abs()).sum();
        let [at_zero, more] = self.biases[output].map(|bias| i64::from(bias).abs());
        sum + at_zero + more * i64::from(u8::MAX) < EXACT && self.shifts[output] <= SHIFTS
    }
}

/// The weights of a display filter.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FilterWeights {
    layers: Vec<Convolution>,
}

impl FilterWeights {
    /// Those that come with the library, for any scene.
    pub fn generic() -> FilterWeights {
        FilterWeights::read(include_bytes!("generic.nvf")).unwrap_or_else(|_| FilterWeights::zero())
    }

    /// Weights that change nothing.
    pub fn zero() -> FilterWeights {
        let layer = |layer| {
            let outputs = Convolution::outputs(layer);
            let bias = if layer + 1 == LAYERS { 128 } else { 0 };
            Convolution {
                weights: vec![0; outputs * Convolution::fan_in(layer)],
                biases: vec![[bias, 0]; outputs],
                shifts: vec![0; outputs],
            }
        };
        FilterWeights { layers: (0..LAYERS).map(layer).collect() }
    }

    /// Takes layers, of the numbers of inputs and outputs above.
    ///
    /// # Errors
    /// [`FilterWeightsError::Range`] if a layer's sums may be inexact, [`FilterWeightsError::Length`] if numbers are
    /// missing.
    pub fn new(layers: Vec<Convolution>) -> Result<FilterWeights, FilterWeightsError> {
        let weights = FilterWeights { layers };
        let found = weights.write().len();
        let fits = weights.layers.len() == LAYERS
            && weights.layers.iter().enumerate().all(|(number, layer)| {
                let outputs = Convolution::outputs(number);
                layer.weights.len() == outputs * Convolution::fan_in(number)
                    && layer.biases.len() == outputs
                    && layer.shifts.len() == outputs
            });
        if !fits {
            return Err(FilterWeightsError::Length { expected: Self::encoded_len(), found });
        }
        for (number, layer) in weights.layers.iter().enumerate() {
            if let Some(output) =
                (0..Convolution::outputs(number)).find(|output| !layer.is_exact(number, *output))
            {
                return Err(FilterWeightsError::Range { layer: number, output });
            }
        }
        Ok(weights)
    }

    /// The convolutions, in order.
    pub fn layers(&self) -> &[Convolution] {
        &self.layers
    }

    /// Their length in bytes.
    pub fn encoded_len() -> usize {
        let layer = |layer| Convolution::outputs(layer) * (Convolution::fan_in(layer) + 8 + 1);
        MAGIC.len() + (0..LAYERS).map(layer).sum::<usize>() + 4
    }

    /// As bytes: `NVF1`; of each layer the weights (i8), the biases (two i32 per output, little-endian) and the
    /// shifts (u8); then the CRC-32 (IEEE) of all before.
    pub fn write(&self) -> Vec<u8> {
        let mut bytes = MAGIC.to_vec();
        for layer in &self.layers {
            bytes.extend(layer.weights.iter().map(|weight| *weight as u8));
            bytes.extend(layer.biases.as_flattened().iter().flat_map(|bias| bias.to_le_bytes()));
            bytes.extend(&layer.shifts);
        }
        let check = Crc::<u32>::new(&CRC_32_ISO_HDLC).checksum(&bytes);
        bytes.extend(check.to_le_bytes());
        bytes
    }

    /// Reads [`FilterWeights::write`]'s bytes.
    ///
    /// # Errors
    /// If they are not of this form, or damaged.
    pub fn read(bytes: &[u8]) -> Result<FilterWeights, FilterWeightsError> {
        if !bytes.starts_with(&MAGIC) {
            return Err(FilterWeightsError::Magic);
        }
        let (expected, found) = (Self::encoded_len(), bytes.len());
        if expected != found {
            return Err(FilterWeightsError::Length { expected, found });
        }
        let (all, check) = bytes.split_at(found - 4);
        if Crc::<u32>::new(&CRC_32_ISO_HDLC).checksum(all).to_le_bytes() != check {
            return Err(FilterWeightsError::Check);
        }
        let mut rest = &all[MAGIC.len()..];
        let mut take = |count: usize| {
            let (taken, after) = rest.split_at(count);
            rest = after;
            taken
        };
        let layers = (0..LAYERS).map(|number| {
            let outputs = Convolution::outputs(number);
            let weights = take(outputs * Convolution::fan_in(number));
            let weights = weights.iter().map(|weight| *weight as i8).collect();
            let numbers = take(8 * outputs).as_chunks::<4>().0;
            let biases = numbers.as_chunks::<2>().0.iter();
            let biases = biases.map(|two| two.map(i32::from_le_bytes)).collect();
            Convolution { weights, biases, shifts: take(outputs).to_vec() }
        });
        FilterWeights::new(layers.collect())
    }
}

#[cfg(test)]
pub(crate) mod tests;
