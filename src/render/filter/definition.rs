//! The display filter in plain whole numbers: what the device must give, byte for byte.

use crate::Picture;
use crate::filter_weights::{Convolution, DILATIONS, FRACTION, FilterWeights, INPUTS, TAPS};

/// A layer's values: blocks row by row, of each all channels.
struct Layer {
    columns: usize,
    rows: usize,
    channels: usize,
    values: Vec<u8>,
}

impl Layer {
    fn new(columns: usize, rows: usize, channels: usize) -> Layer {
        Layer { columns, rows, channels, values: vec![0; columns * rows * channels] }
    }

    /// The channels of a block, or of the nearest within.
    fn block(&self, column: isize, row: isize) -> &[u8] {
        let within = |at: isize, size: usize| at.clamp(0, size as isize - 1) as usize;
        let block = within(row, self.rows) * self.columns + within(column, self.columns);
        &self.values[block * self.channels..(block + 1) * self.channels]
    }
}

/// An input: a picture's channel, or its difference from the render.
pub fn input(picture: u8, render: u8) -> [u8; 2] {
    let difference = i32::from(picture) - i32::from(render);
    [picture, (difference.clamp(-128, 127) + 128) as u8]
}

/// The pixel of a picture that is pixel `k` of a block, or the nearest within.
fn pixel_of(block: [usize; 2], k: usize, size: [usize; 2]) -> usize {
    let [x, y] = [2 * block[0] + k % 2, 2 * block[1] + k / 2];
    y.min(size[1] - 1) * size[0] + x.min(size[0] - 1)
}

fn inputs(picture: &Picture, render: &Picture) -> Layer {
    let size = [picture.width as usize, picture.height as usize];
    let mut layer = Layer::new(size[0].div_ceil(2), size[1].div_ceil(2), INPUTS);
    for (at, values) in layer.values.as_chunks_mut::<INPUTS>().0.iter_mut().enumerate() {
        let block = [at % layer.columns, at / layer.columns];
        for (k, values) in values.as_chunks_mut::<6>().0.iter_mut().enumerate() {
            let first = 3 * pixel_of(block, k, size);
            for channel in 0..3 {
                let byte = first + channel;
                [values[channel], values[3 + channel]] =
                    input(picture.data[byte], render.data[byte]);
            }
        }
    }
    layer
}

fn convolved(convolution: &Convolution, number: usize, from: &Layer, step: u8) -> Layer {
    let mut to = Layer::new(from.columns, from.rows, Convolution::outputs(number));
    let distance = DILATIONS[number] as isize;
    let inputs = from.channels;
    for (at, values) in to.values.chunks_exact_mut(to.channels).enumerate() {
        let (column, row) = ((at % from.columns) as isize, (at / from.columns) as isize);
        let taps: [&[u8]; TAPS] = std::array::from_fn(|tap| {
            let [x, y] = [tap as isize % 3 - 1, tap as isize / 3 - 1];
            from.block(column + x * distance, row + y * distance)
        });
        for (output, value) in values.iter_mut().enumerate() {
            let weights = &convolution.weights[output * inputs * TAPS..];
            let mut sum = convolution.bias(output, step);
            for input in 0..inputs {
                for (tap, values) in taps.iter().enumerate() {
                    sum += i32::from(weights[input * TAPS + tap]) * i32::from(values[input]);
                }
            }
            *value = (sum >> convolution.shifts[output]).clamp(0, 255) as u8;
        }
    }
    to
}

/// A correction, in steps of a level plus 128, added to a byte.
pub fn corrected(byte: u8, correction: u8) -> u8 {
    let by = (i32::from(correction) - 128 + FRACTION / 2).div_euclid(FRACTION);
    (i32::from(byte) + by).clamp(0, 255) as u8
}

/// Filters a picture, which is `render` and a residual that was quantised by step number `step`.
pub fn filtered(weights: &FilterWeights, step: u8, render: &Picture, picture: &Picture) -> Picture {
    let mut layer = inputs(picture, render);
    for (number, convolution) in weights.layers().iter().enumerate() {
        layer = convolved(convolution, number, &layer, step);
    }
    let size = [picture.width as usize, picture.height as usize];
    let mut out = picture.clone();
    for at in 0..layer.columns * layer.rows {
        let block = [at % layer.columns, at / layer.columns];
        for k in 0..4 {
            let [x, y] = [2 * block[0] + k % 2, 2 * block[1] + k / 2];
            if x >= size[0] || y >= size[1] {
                continue;
            }
            for channel in 0..3 {
                let byte = &mut out.data[3 * (y * size[0] + x) + channel];
                *byte = corrected(*byte, layer.values[at * layer.channels + 3 * k + channel]);
            }
        }
    }
    out
}
