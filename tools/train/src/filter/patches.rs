//! Parts of pictures to learn from.

use nvsprior::Picture;
use nvsprior::random::Random;

use super::FilterExample;

/// Side of a patch, blocks of 2×2 pixels.
pub const SIDE: usize = 32;
/// Pixels of a side.
const PIXELS: usize = 2 * SIDE;

/// A part of a frame, of its render and of what was decoded; RGB, row by row.
pub struct Patch {
    pub size: [usize; 2],
    pub frame: Vec<f32>,
    pub render: Vec<f32>,
    pub decoded: Vec<f32>,
    /// Number of the quantiser's step.
    pub step: u8,
}

impl Patch {
    /// One of the examples, mirrored or not.
    pub fn random(sets: &[&[FilterExample]], vary: bool, random: &mut Random) -> Patch {
        let mut below = |count: usize| (random.bits() % count as u64) as usize;
        let set = sets[below(sets.len())];
        let example = &set[below(set.len())];
        let (step, decoded) = &example.decoded[below(example.decoded.len())];
        let whole = [example.frame.width, example.frame.height].map(|v| v as usize);
        let size = whole.map(|v| PIXELS.min(v / 2 * 2));
        let corner = [0, 1].map(|axis| below((whole[axis] - size[axis]) / 2 + 1) * 2);
        let mirrored = [below(2) == 1, below(4) == 0];
        let part = |picture: &Picture| part(picture, corner, size, mirrored);
        let parts = [part(&example.frame), part(&example.render), part(decoded)];
        let [frame, render, decoded] = if vary { varied(parts, random) } else { parts };
        Patch { size, frame, render, decoded, step: *step }
    }
}

/// A part of a picture, mirrored along the axes that say so.
fn part(picture: &Picture, corner: [usize; 2], size: [usize; 2], mirrored: [bool; 2]) -> Vec<f32> {
    let mut values = Vec::with_capacity(3 * size[0] * size[1]);
    for y in 0..size[1] {
        for x in 0..size[0] {
            let at = [x, y];
            let [x, y] = [0, 1].map(|axis| {
                corner[axis] + if mirrored[axis] { size[axis] - 1 - at[axis] } else { at[axis] }
            });
            let first = 3 * (y * picture.width as usize + x);
            values.extend(picture.data[first..first + 3].iter().map(|byte| f32::from(*byte)));
        }
    }
    values
}

/// The same in other light, and with other colours, now and then.
fn varied(mut parts: [Vec<f32>; 3], random: &mut Random) -> [Vec<f32>; 3] {
    if random.bits().is_multiple_of(2) {
        let gain = random.within(0.5, 1.0);
        let offset = random.within(0.0, 255.0 * (1.0 - gain));
        parts.iter_mut().flatten().for_each(|value| *value = *value * gain + offset);
    }
    if random.bits().is_multiple_of(4) {
        let turn = 1 + (random.bits() % 2) as usize;
        for pixel in parts.iter_mut().flat_map(|part| part.as_chunks_mut::<3>().0) {
            pixel.rotate_left(turn);
        }
    }
    parts
}
