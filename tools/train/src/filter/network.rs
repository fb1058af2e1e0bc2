//! The filter's network in floats, as it is trained. One unit is [`UNIT`] steps of the whole numbers that the filter
//! computes with. What the filter rounds is rounded here too; gradients pass as if it were not (Bengio et al. 2013).

use nalgebra::{DMatrixView, DMatrixViewMut, Dyn, MatrixView};
use nvsprior::filter_weights::{
    Convolution, DILATIONS, FRACTION, FilterWeights, FilterWeightsError, INPUTS, LAYERS, OUTPUTS,
    TAPS,
};
use nvsprior::random::Random;

use super::patches::Patch;

/// Steps of the filter's whole numbers in a unit.
const UNIT: f32 = 32.0;
/// Greatest value of an output, units.
const MOST: f32 = 255.0 / UNIT;
/// What the filter's inputs are moved by, to be bytes.
const MIDDLE: f32 = 128.0 / UNIT;
/// The quantiser's step whose number changes no bias, and the steps in a unit of change.
const STEP: (f32, f32) = (38.0, 16.0);
/// Greatest size of a whole weight.
const WEIGHT: f32 = 127.0;
/// What mean squared errors are raised by, so that patches without errors do not count most.
const DOUBT: f32 = 4.0;
/// Half of a step of a correction, levels: the filter rounds such halves up, when it rounds to whole levels.
const HALF: f32 = 0.5 / FRACTION as f32;
/// What biases begin with: most outputs are above 0, where they can learn.
const BIAS: f32 = 0.25;

/// A convolution in floats.
#[derive(Clone)]
struct Layer {
    inputs: usize,
    outputs: usize,
    dilation: usize,
    /// As the filter's.
    weights: Vec<f32>,
    biases: Vec<f32>,
    /// What the quantiser's step adds.
    by_step: Vec<f32>,
}

#[derive(Clone)]
pub struct Network {
    layers: Vec<Layer>,
}

/// What a pass through the network leaves; kept from patch to patch.
#[derive(Default)]
pub struct Workspace {
    /// By layer: the inputs of each tap, by input and tap.
    columns: Vec<Vec<f32>>,
    /// By layer: its outputs, planes.
    outputs: Vec<Vec<f32>>,
    gradient: Vec<f32>,
    column_gradient: Vec<f32>,
}

impl Layer {
    fn zero(number: usize) -> Layer {
        let (inputs, outputs) = (Convolution::inputs(number), Convolution::outputs(number));
        Layer {
            inputs,
            outputs,
            dilation: DILATIONS[number] as usize,
            weights: vec![0.0; outputs * inputs * TAPS],
            biases: vec![0.0; outputs],
            by_step: vec![0.0; outputs],
        }
    }

    /// Weights of an output.
    fn fan_in(&self) -> usize {
        self.inputs * TAPS
    }

    /// Binary places of the whole weights of an output.
    fn shift(&self, output: usize) -> u8 {
        let weights = &self.weights[output * self.fan_in()..(output + 1) * self.fan_in()];
        let largest = weights.iter().fold(1e-4f32, |most, weight| most.max(weight.abs()));
        (WEIGHT / largest).log2().floor().clamp(0.0, 14.0) as u8
    }

    fn step_of(step: u8) -> f32 {
        (f32::from(step) - STEP.0) / STEP.1
    }
}

impl Network {
    /// He's weights (He et al. 2015), but for the last layer, which begins with zeros. At first the filter changes
    /// nothing. So no layer learns to give nothing, which none recovers from.
    pub fn random(random: &mut Random) -> Network {
        let mut layers: Vec<_> = (0..LAYERS).map(Layer::zero).collect();
        for layer in &mut layers[..LAYERS - 1] {
            // Of this width, an even distribution has the wanted deviation.
            let width = (6.0 / layer.fan_in() as f32).sqrt();
            layer.weights.iter_mut().for_each(|weight| *weight = random.within(-width, width));
            layer.biases.fill(BIAS);
        }
        Network { layers }
    }

    /// The network that whole weights stand for.
    pub fn of(weights: &FilterWeights) -> Network {
        let mut layers: Vec<_> = (0..LAYERS).map(Layer::zero).collect();
        for (number, (layer, whole)) in layers.iter_mut().zip(weights.layers()).enumerate() {
            let fan_in = layer.fan_in();
            for output in 0..layer.outputs {
                let one = (1u32 << whole.shifts[output]) as f32;
                let places = output * fan_in..(output + 1) * fan_in;
                let own = &mut layer.weights[places.clone()];
                let sum: f32 = whole.weights[places].iter().map(|w| f32::from(*w)).sum();
                let pairs = own.iter_mut().zip(&whole.weights[output * fan_in..]);
                pairs.for_each(|(to, from)| *to = f32::from(*from) / one);
                let [at_zero, more] = whole.biases[output].map(|bias| bias as f32);
                let moved = if number == 0 { 128.0 * sum } else { 0.0 };
                let middle = if number + 1 == LAYERS { 128.0 } else { 0.0 };
                let at_step = at_zero + more * STEP.0 + moved;
                layer.biases[output] = ((at_step / one) - 0.5 - middle) / UNIT;
                layer.by_step[output] = more * STEP.1 / one / UNIT;
            }
        }
        Network { layers }
    }

    /// The whole weights that stand for it.
    ///
    /// # Errors
    /// If biases have grown beyond what the filter holds exactly.
    pub fn quantised(&self) -> Result<FilterWeights, FilterWeightsError> {
        let whole = |(number, layer): (usize, &Layer)| {
            let fan_in = layer.fan_in();
            let shifts: Vec<u8> = (0..layer.outputs).map(|output| layer.shift(output)).collect();
            let mut weights = Vec::with_capacity(layer.weights.len());
            let mut biases = Vec::with_capacity(layer.outputs);
            for (output, shift) in shifts.iter().enumerate() {
                let one = f64::from(1u32 << shift);
                let own = &layer.weights[output * fan_in..(output + 1) * fan_in];
                let own: Vec<i8> =
                    own.iter().map(|w| (f64::from(*w) * one).round() as i8).collect();
                let sum: f64 = own.iter().map(|w| f64::from(*w)).sum();
                let moved = if number == 0 { 128.0 * sum } else { 0.0 };
                let middle = if number + 1 == LAYERS { 128.0 } else { 0.0 };
                let units = f64::from(layer.biases[output]) * f64::from(UNIT);
                let more = f64::from(layer.by_step[output] * UNIT / STEP.1) * one;
                let more = more.round();
                let at_step = (units + 0.5 + middle) * one - moved;
                biases.push([(at_step - more * f64::from(STEP.0)).round() as i32, more as i32]);
                weights.extend(own);
            }
            Convolution { weights, biases, shifts }
        };
        let layers = self.layers.iter().enumerate().map(whole).collect();
        FilterWeights::new(layers)
    }

    /// The same network with its weights rounded as whole ones are.
    pub fn rounded(&self) -> Network {
        let mut rounded = self.clone();
        for (layer, from) in rounded.layers.iter_mut().zip(&self.layers) {
            for (output, weights) in layer.weights.chunks_exact_mut(from.fan_in()).enumerate() {
                let one = (1u32 << from.shift(output)) as f32;
                weights.iter_mut().for_each(|weight| *weight = (*weight * one).round() / one);
            }
        }
        rounded
    }

    pub fn zeros(&self) -> Network {
        Network { layers: (0..LAYERS).map(Layer::zero).collect() }
    }

    pub fn clear(&mut self) {
        self.values_mut().for_each(|value| *value = 0.0);
    }

    pub fn add(&mut self, other: &Network) {
        self.values_mut().zip(other.values()).for_each(|(to, from)| *to += from);
    }

    pub fn len(&self) -> usize {
        self.values().count()
    }

    pub fn values(&self) -> impl Iterator<Item = &f32> {
        self.layers.iter().flat_map(|l| l.weights.iter().chain(&l.biases).chain(&l.by_step))
    }

    pub fn values_mut(&mut self) -> impl Iterator<Item = &mut f32> {
        self.layers
            .iter_mut()
            .flat_map(|l| l.weights.iter_mut().chain(&mut l.biases).chain(&mut l.by_step))
    }

    /// Adds the gradient of a patch's loss: the logarithm of the mean squared error, less that of what it was. So a
    /// patch whose error grows much, as at first, does not outweigh the others.
    pub fn learn(&self, patch: &Patch, space: &mut Workspace, gradient: &mut Network) -> f64 {
        let blocks = patch.size.map(|side| side / 2);
        let count = blocks[0] * blocks[1];
        space.columns.resize_with(LAYERS, Vec::new);
        space.outputs.resize_with(LAYERS, Vec::new);
        let step = Layer::step_of(patch.step);
        let input = inputs(patch, blocks);
        for number in 0..LAYERS {
            let layer = &self.layers[number];
            let (before, own) = space.outputs.split_at_mut(number);
            let from = before.last().unwrap_or(&input);
            let columns = &mut space.columns[number];
            columns.resize(layer.fan_in() * count, 0.0);
            spread(from, columns, layer, blocks);
            let outputs = &mut own[0];
            outputs.resize(layer.outputs * count, 0.0);
            multiply(layer, columns, outputs, count);
            finish(layer, outputs, count, step, number + 1 == LAYERS);
        }
        let loss = self.end(patch, blocks, space);
        for number in (0..LAYERS).rev() {
            self.back(number, blocks, step, space, gradient);
        }
        loss
    }

    /// The loss, and its gradient by the last layer's outputs.
    fn end(&self, patch: &Patch, blocks: [usize; 2], space: &mut Workspace) -> f64 {
        let count = blocks[0] * blocks[1];
        let numbers = (OUTPUTS * count) as f32;
        let level = UNIT / FRACTION as f32;
        let outputs = &space.outputs[LAYERS - 1];
        let before: f32 =
            patch.decoded.iter().zip(&patch.frame).map(|(a, b)| (a - b) * (a - b)).sum();
        space.gradient.resize(OUTPUTS * count, 0.0);
        let mut sum = 0.0f32;
        for output in 0..OUTPUTS {
            let (pixel, channel) = (output / 3, output % 3);
            for block in 0..count {
                let x = 2 * (block % blocks[0]) + pixel % 2;
                let y = 2 * (block / blocks[0]) + pixel / 2;
                let at = 3 * (y * patch.size[0] + x) + channel;
                let place = output * count + block;
                let shown = patch.decoded[at] + level * outputs[place] + HALF;
                let error = shown - patch.frame[at];
                sum += error * error;
                space.gradient[place] = error;
            }
        }
        let after = sum / numbers + DOUBT;
        let factor = 2.0 * level / (numbers * after);
        space.gradient.iter_mut().for_each(|by| *by *= factor);
        f64::from((after / (before / numbers + DOUBT)).ln())
    }

    /// From the gradient by a layer's outputs to that by its weights and inputs.
    fn back(
        &self,
        number: usize,
        blocks: [usize; 2],
        step: f32,
        space: &mut Workspace,
        gradient: &mut Network,
    ) {
        let (layer, to) = (&self.layers[number], &mut gradient.layers[number]);
        let count = blocks[0] * blocks[1];
        if number + 1 < LAYERS {
            let outputs = space.gradient.iter_mut().zip(&space.outputs[number]);
            // Where the output is held at an end, nothing moves it.
            let held = |value: f32| value <= 0.0 || value >= MOST;
            outputs.filter(|(_, output)| held(**output)).for_each(|(by, _)| *by = 0.0);
        }
        for (output, by) in space.gradient.chunks_exact(count).enumerate() {
            let sum: f32 = by.iter().sum();
            to.biases[output] += sum;
            to.by_step[output] += sum * step;
        }
        let fan_in = layer.fan_in();
        let by_outputs = DMatrixView::from_slice(&space.gradient, count, layer.outputs);
        let columns = turned(&space.columns[number], fan_in, count);
        DMatrixViewMut::from_slice(&mut to.weights, fan_in, layer.outputs).gemm(
            1.0,
            &columns,
            &by_outputs,
            1.0,
        );
        if number == 0 {
            return;
        }
        space.column_gradient.resize(fan_in * count, 0.0);
        let weights = turned(&layer.weights, layer.outputs, fan_in);
        DMatrixViewMut::from_slice(&mut space.column_gradient, count, fan_in).gemm(
            1.0,
            &by_outputs,
            &weights,
            0.0,
        );
        space.gradient.clear();
        space.gradient.resize(layer.inputs * count, 0.0);
        gather(&space.column_gradient, &mut space.gradient, layer, blocks);
    }
}

/// A matrix that lies row by row.
fn turned(values: &[f32], rows: usize, columns: usize) -> MatrixView<'_, f32, Dyn, Dyn, Dyn, Dyn> {
    DMatrixView::from_slice_with_strides(values, rows, columns, columns, 1)
}

/// What the first layer reads of a patch, planes.
fn inputs(patch: &Patch, blocks: [usize; 2]) -> Vec<f32> {
    let count = blocks[0] * blocks[1];
    let mut planes = vec![0.0; INPUTS * count];
    for block in 0..count {
        for pixel in 0..4 {
            let x = 2 * (block % blocks[0]) + pixel % 2;
            let y = 2 * (block / blocks[0]) + pixel / 2;
            for channel in 0..3 {
                let at = 3 * (y * patch.size[0] + x) + channel;
                let difference = (patch.decoded[at] - patch.render[at]).clamp(-128.0, 127.0);
                let input = 6 * pixel + channel;
                planes[input * count + block] = patch.decoded[at] / UNIT - MIDDLE;
                planes[(input + 3) * count + block] = difference / UNIT;
            }
        }
    }
    planes
}

/// Calls `visit` for each input and tap of a layer, with the offset of the tap, columns and rows.
fn for_each_tap(layer: &Layer, mut visit: impl FnMut(usize, usize, [isize; 2])) {
    let distance = layer.dilation as isize;
    for input in 0..layer.inputs {
        for tap in 0..TAPS {
            let offset = [tap % 3, tap / 3].map(|place| (place as isize - 1) * distance);
            visit(input, tap, offset);
        }
    }
}

/// Where a row or column's tap lies: within, or at the end.
fn within(at: usize, offset: isize, size: usize) -> usize {
    (at as isize + offset).clamp(0, size as isize - 1) as usize
}

/// The inputs of each tap, as [`Workspace::columns`] has them.
fn spread(from: &[f32], columns: &mut [f32], layer: &Layer, blocks: [usize; 2]) {
    let [width, height] = blocks;
    let count = width * height;
    for_each_tap(layer, |input, tap, offset| {
        let from = &from[input * count..(input + 1) * count];
        let place = (input * TAPS + tap) * count;
        let rows = columns[place..place + count].chunks_exact_mut(width);
        for (y, to) in rows.enumerate() {
            let first = within(y, offset[1], height) * width;
            shift(&from[first..first + width], to, offset[0]);
        }
    });
}

/// Copies a row, moved; what comes from outside is the value at the end.
fn shift(from: &[f32], to: &mut [f32], by: isize) {
    let (width, far) = (from.len(), by.unsigned_abs().min(from.len()));
    if by < 0 {
        to[far..].copy_from_slice(&from[..width - far]);
        to[..far].fill(from[0]);
    } else {
        to[..width - far].copy_from_slice(&from[far..]);
        to[width - far..].fill(from[width - 1]);
    }
}

/// Sums the gradients by each tap's inputs into those by the inputs: the transpose of [`spread`].
fn gather(columns: &[f32], to: &mut [f32], layer: &Layer, blocks: [usize; 2]) {
    let [width, height] = blocks;
    let count = width * height;
    for_each_tap(layer, |input, tap, offset| {
        let to = &mut to[input * count..(input + 1) * count];
        let place = (input * TAPS + tap) * count;
        for (y, from) in columns[place..place + count].chunks_exact(width).enumerate() {
            let first = within(y, offset[1], height) * width;
            shift_back(from, &mut to[first..first + width], offset[0]);
        }
    });
}

/// The transpose of [`shift`], added.
fn shift_back(from: &[f32], to: &mut [f32], by: isize) {
    let (width, far) = (from.len(), by.unsigned_abs().min(from.len()));
    let add = |to: &mut [f32], from: &[f32]| to.iter_mut().zip(from).for_each(|(t, f)| *t += f);
    if by < 0 {
        add(&mut to[..width - far], &from[far..]);
        to[0] += from[..far].iter().sum::<f32>();
    } else {
        add(&mut to[far..], &from[..width - far]);
        to[width - 1] += from[width - far..].iter().sum::<f32>();
    }
}

fn multiply(layer: &Layer, columns: &[f32], outputs: &mut [f32], count: usize) {
    let columns = DMatrixView::from_slice(columns, count, layer.fan_in());
    let weights = DMatrixView::from_slice(&layer.weights, layer.fan_in(), layer.outputs);
    DMatrixViewMut::from_slice(outputs, count, layer.outputs).gemm(1.0, &columns, &weights, 0.0);
}

/// Adds biases, rounds as the filter does, and holds outputs at their ends; those of the last layer lie around 0.
fn finish(layer: &Layer, outputs: &mut [f32], count: usize, step: f32, last: bool) {
    let (low, high) = if last { (-MIDDLE, MOST - MIDDLE) } else { (0.0, MOST) };
    for (output, values) in outputs.chunks_exact_mut(count).enumerate() {
        let bias = layer.biases[output] + step * layer.by_step[output];
        values.iter_mut().for_each(|value| {
            *value = (((*value + bias) * UNIT).round() / UNIT).clamp(low, high);
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn patch(random: &mut Random, size: [usize; 2]) -> Patch {
        let mut bytes = |near: Option<&Vec<f32>>| -> Vec<f32> {
            let byte = |at| near.map_or(128.0, |near: &Vec<f32>| near[at]);
            (0..3 * size[0] * size[1])
                .map(|at| (byte(at) + random.within(-30.0, 30.0)).round().clamp(0.0, 255.0))
                .collect()
        };
        let frame = bytes(None);
        let (render, decoded) = (bytes(Some(&frame)), bytes(Some(&frame)));
        Patch { size, frame, render, decoded, step: 41 }
    }

    /// Weights, biases and what steps add, all so that no output is held at an end by much.
    fn network(random: &mut Random) -> Network {
        let mut network = Network::random(random);
        let last = &mut network.layers[LAYERS - 1];
        last.weights.iter_mut().for_each(|weight| *weight = random.within(-0.02, 0.02));
        for layer in &mut network.layers {
            layer.biases.iter_mut().for_each(|bias| *bias = random.within(0.0, 0.5));
            layer.by_step.iter_mut().for_each(|by| *by = random.within(-0.1, 0.1));
        }
        network
    }

    #[test]
    fn shifts_and_their_transposes_agree() {
        let mut random = Random::new(3);
        for width in [1, 2, 5, 9] {
            for by in [-4, -1, 0, 2, 4] {
                let a: Vec<f32> = (0..width).map(|_| random.within(-1.0, 1.0)).collect();
                let b: Vec<f32> = (0..width).map(|_| random.within(-1.0, 1.0)).collect();
                let (mut moved, mut back) = (vec![0.0; width], vec![0.0; width]);
                shift(&a, &mut moved, by);
                shift_back(&b, &mut back, by);
                let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
                assert!((dot(&moved, &b) - dot(&a, &back)).abs() < 1e-5, "{width} by {by}");
            }
        }
    }

    #[test]
    fn whole_weights_are_what_they_were_made_of() {
        let mut random = Random::new(4);
        let network = network(&mut random);
        let whole = network.quantised().unwrap();
        let again = Network::of(&whole);
        for (a, b) in network.rounded().values().zip(again.values()) {
            assert!((a - b).abs() < 2e-3, "{a} {b}");
        }
    }

    #[test]
    fn the_loss_is_that_of_the_whole_filter() {
        let mut random = Random::new(5);
        let network = network(&mut random);
        let patch = patch(&mut random, [24, 18]);
        let mut space = Workspace::default();
        let found = network.rounded().learn(&patch, &mut space, &mut network.zeros());
        let picture = |values: &[f32]| {
            let mut picture = nvsprior::Picture::new(24, 18);
            picture.data.iter_mut().zip(values).for_each(|(to, from)| *to = *from as u8);
            picture
        };
        let (render, decoded) = (picture(&patch.render), picture(&patch.decoded));
        let frame = picture(&patch.frame);
        let filtered = nvsprior::render::filter::definition::filtered(
            &network.quantised().unwrap(),
            41,
            &render,
            &decoded,
        );
        let square = |a: &nvsprior::Picture| {
            let pairs = a.data.iter().zip(&frame.data);
            let squares = pairs.map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2));
            squares.sum::<f64>() / a.data.len() as f64
        };
        let [after, before] =
            [&filtered, &decoded].map(|picture| square(picture) + f64::from(DOUBT));
        let expected = (after / before).ln();
        assert!(expected.abs() > 0.01, "the filter changes something: {expected}");
        assert!((found - expected).abs() < 2e-3, "{found} for {expected}");
    }

    #[test]
    fn gradients_are_differences_of_the_loss() {
        let mut random = Random::new(6);
        let network = network(&mut random);
        let patch = patch(&mut random, [16, 16]);
        let mut space = Workspace::default();
        let mut gradient = network.zeros();
        network.learn(&patch, &mut space, &mut gradient);
        let gradient: Vec<f32> = gradient.values().copied().collect();
        // Along a random direction, as single differences drown in what rounding does.
        for seed in 0..4 {
            let mut random = Random::new(70 + seed);
            let by: Vec<f32> =
                gradient.iter().map(|g| g.signum() * random.within(0.0, 1.0)).collect();
            let slope: f64 = gradient.iter().zip(&by).map(|(g, b)| f64::from(g * b)).sum();
            let mut at = |step: f32| {
                let mut other = network.clone();
                other.values_mut().zip(&by).for_each(|(value, by)| *value += step * by);
                other.learn(&patch, &mut space, &mut network.zeros())
            };
            let step = 1e-4;
            let found = (at(step) - at(-step)) / f64::from(2.0 * step);
            assert!((found / slope - 1.0).abs() < 0.15, "{found} for {slope}");
        }
    }
}
