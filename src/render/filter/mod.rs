//! The display filter: a small network that makes a decoded picture look more like what the camera saw.
//!
//! It is for the topside's screen alone: nothing is predicted from a filtered picture, and a packet says nothing of it.
//! The network and its weights: [`filter_weights`](crate::filter_weights). Every device gives the same bytes.

pub mod definition;

use std::sync::Arc;

use crate::Picture;
use crate::filter::{
    FILTER_ENDS, FILTER_GROUP, FILTER_OUTPUTS, FILTER_RUN, FILTER_WEIGHTS, FilterLayer,
};
use crate::filter_weights::{Convolution, DILATIONS, FilterWeights, INPUTS, LAYERS, TAPS};
use crate::vulkan::{Buffer, Commands, Device, Error, Memory, Recorder, Timing};

use super::Scene;
use super::kernels::FilterKernels;
use definition::{corrected, input};

/// Floats of a `Vec4`.
const VECTOR: usize = 4;
/// Outputs that an invocation makes.
const GROUP_OUTPUTS: usize = FILTER_OUTPUTS as usize;

/// What display filters for the pictures of a prior are made of.
pub struct FilterPlan {
    device: Device,
    kernels: FilterKernels,
    weights: Arc<FilterWeights>,
}

impl FilterPlan {
    /// With the weights of the prior's scene, or else the library's. Builds a pipeline.
    ///
    /// # Errors
    /// If the device fails.
    pub fn new(device: &Device, scene: &Scene) -> Result<FilterPlan, Error> {
        let weights = scene.filter_weights().cloned();
        let weights = weights.unwrap_or_else(|| Arc::new(FilterWeights::generic()));
        Ok(FilterPlan { device: device.clone(), kernels: FilterKernels::new(device)?, weights })
    }

    /// The filter for pictures of a size.
    ///
    /// # Errors
    /// As for [`DisplayFilter::new`].
    pub fn filter(&self, width: u32, height: u32) -> Result<DisplayFilter, Error> {
        DisplayFilter::new(&self.device, &self.kernels, &self.weights, width, height)
    }
}

/// Filters pictures of one size, in memory of its own.
pub struct DisplayFilter {
    weights: FilterWeights,
    size: [usize; 2],
    blocks: [usize; 2],
    /// Words of a picture's blocks, as the first layer reads them.
    words: Vec<u32>,
    /// Biases and scales of all layers.
    end_floats: Vec<f32>,
    input: Buffer,
    ends: Buffer,
    corrections: Buffer,
    commands: Commands,
}

/// Groups of eight outputs of a layer.
fn groups(layer: usize) -> usize {
    Convolution::outputs(layer).div_ceil(GROUP_OUTPUTS)
}

/// Floats of a layer's weights on the device.
fn floats_of_weights(layer: usize) -> usize {
    groups(layer) * TAPS * Convolution::inputs(layer) / 4 * FILTER_WEIGHTS as usize * VECTOR
}

/// Floats of a layer's biases and scales on the device.
fn floats_of_ends(layer: usize) -> usize {
    groups(layer) * FILTER_ENDS as usize * VECTOR
}

/// A layer's weights as stage `filter_layer` reads them: by group of outputs, tap, input and output.
fn push_weights(convolution: &Convolution, layer: usize, floats: &mut Vec<f32>) {
    let inputs = Convolution::inputs(layer);
    for group in 0..groups(layer) {
        for tap in 0..TAPS {
            for input in 0..inputs {
                for k in 0..GROUP_OUTPUTS {
                    let place = ((group * GROUP_OUTPUTS + k) * inputs + input) * TAPS + tap;
                    floats.push(f32::from(convolution.weights.get(place).copied().unwrap_or(0)));
                }
            }
        }
    }
}

/// A layer's biases and scales, by group of outputs.
fn push_ends(convolution: &Convolution, layer: usize, step: u8, floats: &mut Vec<f32>) {
    let outputs = Convolution::outputs(layer);
    for group in 0..groups(layer) {
        let places = group * GROUP_OUTPUTS..(group + 1) * GROUP_OUTPUTS;
        let bias = |place: usize| (place < outputs).then(|| convolution.bias(place, step) as f32);
        let scale = |place: usize| {
            (place < outputs).then(|| 1.0 / (1u32 << convolution.shifts[place]) as f32)
        };
        floats.extend(places.clone().map(|place| bias(place).unwrap_or(0.0)));
        floats.extend(places.map(|place| scale(place).unwrap_or(0.0)));
    }
}

impl DisplayFilter {
    /// Makes one for pictures of a size.
    ///
    /// # Errors
    /// If the device has no room, or a picture's layers exceed what one buffer may hold.
    pub fn new(
        device: &Device,
        kernels: &FilterKernels,
        weights: &FilterWeights,
        width: u32,
        height: u32,
    ) -> Result<DisplayFilter, Error> {
        let size = [width, height].map(|v| v as usize);
        let blocks = size.map(|v| v.div_ceil(2));
        let count = blocks[0] * blocks[1];
        let words = |layer| count * groups(layer) * GROUP_OUTPUTS / 4;
        let buffer = |name, words, memory| Buffer::new::<u32>(device, name, words, memory);
        let input = buffer("filter: input", count * INPUTS / 4, Memory::Upload)?;
        let corrections = buffer("filter: corrections", words(LAYERS - 1), Memory::Readback)?;
        let between = [
            buffer("filter: layer", words(0), Memory::Device)?,
            buffer("filter: layer", words(1), Memory::Device)?,
        ];
        let (mut floats, mut end_floats) = (Vec::new(), Vec::new());
        for (number, layer) in weights.layers().iter().enumerate() {
            push_weights(layer, number, &mut floats);
            push_ends(layer, number, 0, &mut end_floats);
        }
        let floats_of = |name, floats: &[f32]| {
            let mut buffer = Buffer::new::<f32>(device, name, floats.len(), Memory::Upload)?;
            buffer.write(floats);
            Ok::<_, Error>(buffer)
        };
        let weight_buffer = floats_of("filter: weights", &floats)?;
        let ends = floats_of("filter: biases", &end_floats)?;
        let mut recorder = Recorder::new(device, Timing::None)?;
        let (mut first_weight, mut first_end) = (0, 0);
        for layer in 0..LAYERS {
            let from = if layer == 0 { &input } else { &between[(layer - 1) % 2] };
            let to = if layer + 1 == LAYERS { &corrections } else { &between[layer % 2] };
            let push = FilterLayer {
                width: blocks[0] as u32,
                height: blocks[1] as u32,
                words: (Convolution::inputs(layer) / 4) as u32,
                dilation: DILATIONS[layer],
                weights: (first_weight / VECTOR) as u32,
                ends: (first_end / VECTOR) as u32,
            };
            let along = |size: usize, by: u32| (size as u32).div_ceil(by * FILTER_GROUP);
            let dispatched =
                [along(blocks[0], FILTER_RUN), along(blocks[1], 1), groups(layer) as u32];
            let buffers = [from, &weight_buffer, &ends, to];
            recorder.dispatch(&kernels.filter_layer, &buffers, &push.words(), dispatched)?;
            first_weight += floats_of_weights(layer);
            first_end += floats_of_ends(layer);
        }
        Ok(DisplayFilter {
            weights: weights.clone(),
            size,
            blocks,
            words: Vec::with_capacity(count * INPUTS / 4),
            end_floats,
            input,
            ends,
            corrections,
            commands: recorder.finish()?,
        })
    }

    /// Filters a picture of the filter's size, which is `render` and a residual that was quantised by step number
    /// `step`.
    ///
    /// # Errors
    /// If the device fails. The picture is then as it was.
    ///
    /// # Panics
    /// If the pictures have another size.
    pub fn apply(&mut self, step: u8, render: &[u8], picture: &mut Picture) -> Result<(), Error> {
        let bytes = 3 * self.size[0] * self.size[1];
        assert_eq!([render.len(), picture.data.len()], [bytes; 2], "sizes of the pictures");
        self.take(render, &picture.data);
        self.input.write(&self.words);
        self.end_floats.clear();
        for (number, layer) in self.weights.layers().iter().enumerate() {
            push_ends(layer, number, step, &mut self.end_floats);
        }
        self.ends.write(&self.end_floats);
        self.commands.run()?;
        self.correct(&mut picture.data);
        Ok(())
    }

    /// Sets the words of the input: six planes of blocks. Their bytes are those of `definition`.
    fn take(&mut self, render: &[u8], picture: &[u8]) {
        let [columns, rows] = self.blocks;
        let [width, height] = self.size;
        self.words.resize(columns * rows * INPUTS / 4, 0);
        let plane = columns * rows;
        for row in 0..rows {
            for column in 0..columns {
                let mut values = [0; INPUTS];
                for (k, values) in values.as_chunks_mut::<6>().0.iter_mut().enumerate() {
                    let y = (2 * row + k / 2).min(height - 1);
                    let x = (2 * column + k % 2).min(width - 1);
                    let first = 3 * (y * width + x);
                    for channel in 0..3 {
                        let byte = first + channel;
                        [values[channel], values[3 + channel]] = input(picture[byte], render[byte]);
                    }
                }
                let words = values.as_chunks::<4>().0;
                for (number, bytes) in words.iter().enumerate() {
                    self.words[number * plane + row * columns + column] =
                        u32::from_le_bytes(*bytes);
                }
            }
        }
    }

    /// Adds what the last layer left.
    fn correct(&self, picture: &mut [u8]) {
        let [columns, rows] = self.blocks;
        let [width, height] = self.size;
        let plane = columns * rows;
        let words = self.corrections.read::<u32>(3 * plane);
        for y in 0..height {
            for x in 0..width {
                let block = y / 2 * columns + x / 2;
                let first = 3 * (2 * (y % 2) + x % 2);
                for channel in 0..3 {
                    let output = first + channel;
                    let word = words[output / 4 * plane + block];
                    let byte = &mut picture[3 * (y * width + x) + channel];
                    *byte = corrected(*byte, word.to_le_bytes()[output % 4]);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests;
