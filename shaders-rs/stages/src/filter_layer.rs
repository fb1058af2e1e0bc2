//! Stage `filter_layer`: a layer of the display filter, a convolution of 3×3 taps.
//!
//! All values are whole numbers below 2²⁴, which f32 holds: sums are exact in any order, so every device makes the same
//! bytes. The host checks that no weights can exceed it.

use crate::filter::{FILTER_ENDS, FILTER_OUTPUTS, FILTER_RUN, FILTER_WEIGHTS, FilterLayer};
use crate::memory::{at, at_mut};
use spirv_std::glam::{UVec3, Vec4};
use spirv_std::spirv;

/// Sums of eight outputs of one block.
#[derive(Clone, Copy)]
struct Sums {
    low: Vec4,
    high: Vec4,
}

impl Sums {
    fn zero() -> Sums {
        Sums { low: Vec4::ZERO, high: Vec4::ZERO }
    }

    /// With an input and its weights.
    fn with(self, low: Vec4, high: Vec4, value: f32) -> Sums {
        Sums { low: self.low + low * value, high: self.high + high * value }
    }
}

/// Byte `i` of a word, as a number.
fn byte(word: u32, i: u32) -> f32 {
    ((word >> (8 * i)) & 0xff) as f32
}

/// A column or row of blocks within the picture.
fn clamped(at: i32, size: u32) -> u32 {
    let low = if at > 0 { at } else { 0 };
    let most = size as i32 - 1;
    (if low < most { low } else { most }) as u32
}

/// What a sum becomes: 0 to 255.
fn ended(sum: f32, bias: f32, scale: f32) -> u32 {
    let sum = sum + bias;
    let positive = if sum > 0.0 { sum } else { 0.0 };
    let value = positive * scale;
    (if value < 255.0 { value } else { 255.0 }) as u32
}

/// Four of them, as a word.
fn ended_word(sums: Vec4, bias: Vec4, scale: Vec4) -> u32 {
    ended(sums.x, bias.x, scale.x)
        | ended(sums.y, bias.y, scale.y) << 8
        | ended(sums.z, bias.z, scale.z) << 16
        | ended(sums.w, bias.w, scale.w) << 24
}

/// One invocation per four blocks of a row and eight outputs.
#[spirv(compute(threads(8, 8)))]
pub fn filter_layer(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(push_constant)] layer: &FilterLayer,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] input: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] weights: &[Vec4],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] ends: &[Vec4],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] output: &mut [u32],
) {
    let (width, height) = (layer.width, layer.height);
    let (x, y) = (id.x * FILTER_RUN, id.y);
    if (x >= width) | (y >= height) {
        return;
    }
    let plane = width * height;
    let mut a = Sums::zero();
    let mut b = Sums::zero();
    let mut c = Sums::zero();
    let mut d = Sums::zero();
    let mut first = layer.weights + id.z * 9 * layer.words * FILTER_WEIGHTS;
    let mut tap = 0u32;
    while tap < 9 {
        let down = ((tap / 3) as i32 - 1) * layer.dilation as i32;
        let across = ((tap % 3) as i32 - 1) * layer.dilation as i32;
        let row = clamped(y as i32 + down, height) * width;
        let column = x as i32 + across;
        let mut from = [
            row + clamped(column, width),
            row + clamped(column + 1, width),
            row + clamped(column + 2, width),
            row + clamped(column + 3, width),
        ];
        let mut word = 0;
        while word < layer.words {
            let words =
                [at(input, from[0]), at(input, from[1]), at(input, from[2]), at(input, from[3])];
            // Written out, as a loop would keep the sums in memory.
            macro_rules! add {
                ($($i:literal)+) => {$(
                    let (low, high) = (at(weights, first + 2 * $i), at(weights, first + 2 * $i + 1));
                    a = a.with(low, high, byte(words[0], $i));
                    b = b.with(low, high, byte(words[1], $i));
                    c = c.with(low, high, byte(words[2], $i));
                    d = d.with(low, high, byte(words[3], $i));
                )+};
            }
            add!(0 1 2 3);
            first += FILTER_WEIGHTS;
            from = [from[0] + plane, from[1] + plane, from[2] + plane, from[3] + plane];
            word += 1;
        }
        tap += 1;
    }
    let end = layer.ends + id.z * FILTER_ENDS;
    let bias = [at(ends, end), at(ends, end + 1)];
    let scale = [at(ends, end + 2), at(ends, end + 3)];
    let to = id.z * (FILTER_OUTPUTS / 4) * plane + y * width + x;
    macro_rules! write {
        ($($k:literal $sums:ident)+) => {$(
            if x + $k < width {
                *at_mut(output, to + $k) = ended_word($sums.low, bias[0], scale[0]);
                *at_mut(output, to + plane + $k) = ended_word($sums.high, bias[1], scale[1]);
            }
        )+};
    }
    write!(0 a 1 b 2 c 3 d);
}
