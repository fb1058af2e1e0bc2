//! The 9/7 wavelet (Cohen, Daubechies, Feauveau) by lifting, in integers.
//!
//! The low band keeps the mean of the picture: a flat picture's low band has its value at every level. The
//! high band is as the lifting steps leave it. Sums wrap around, so that damaged input gives a picture, whatever
//! it shows; pictures of 8 bits in [`FRACTION`] binary places stay far from that.

/// Binary places of a plane's values.
pub const FRACTION: u32 = 6;

/// Lifting steps in 12 binary places, in the order of the forward transform: α and γ of the odd samples, β and
/// δ of the even ones (Daubechies and Sweldens 1998, table of the 9/7 filters).
const STEPS: [(usize, i32); 4] = [(1, -6497), (0, -217), (1, 3616), (0, 1817)];
/// What lifting multiplies a mean by, and its inverse, in 12 binary places.
const GAIN: i32 = 5039;
const INVERSE_GAIN: i32 = 3330;
const PLACES: u32 = 12;

fn scaled(value: i32, factor: i32) -> i32 {
    value.wrapping_mul(factor).wrapping_add(1 << (PLACES - 1)) >> PLACES
}

/// Index of a line's neighbours, mirrored at its ends.
fn neighbours(index: usize, len: usize) -> (usize, usize) {
    let before = if index == 0 { 1 } else { index - 1 };
    let after = if index + 1 < len { index + 1 } else { index - 1 };
    (before, after)
}

/// Room for one level's rows and columns.
pub struct Scratch(Vec<i32>);

impl Scratch {
    /// For planes of `len` values.
    pub fn new(len: usize) -> Scratch {
        Scratch(vec![0; len.max(1)])
    }
}

/// Divides a low band of a size, in the upper left corner of a plane with rows of `stride` values, into the bands of
/// the next level.
pub fn forward(
    plane: &mut [i32],
    stride: usize,
    (width, height): (usize, usize),
    scratch: &mut Scratch,
) {
    if width > 1 {
        let (even, odd) = scratch.0[..width].split_at_mut(width.div_ceil(2));
        for row in plane.chunks_mut(stride).take(height) {
            let row = &mut row[..width];
            for (i, pair) in row.chunks(2).enumerate() {
                even[i] = pair[0];
                pair.get(1).inspect(|value| odd[i] = **value);
            }
            for (parity, factor) in STEPS {
                lift_line(even, odd, parity, factor);
            }
            let (low, high) = row.split_at_mut(even.len());
            for (to, value) in low.iter_mut().zip(&*even) {
                *to = scaled(*value, INVERSE_GAIN);
            }
            high.copy_from_slice(odd);
        }
    }
    if height > 1 {
        for (parity, factor) in STEPS {
            lift_rows(plane, stride, (width, height), parity, factor);
        }
        let low = height.div_ceil(2);
        let room = &mut scratch.0[..width * height];
        gather(plane, stride, width, room);
        for (i, from) in room.chunks(width).enumerate() {
            let to = if i % 2 == 0 { i / 2 } else { low + i / 2 };
            let row = &mut plane[to * stride..to * stride + width];
            for (to, from) in row.iter_mut().zip(from) {
                *to = if i % 2 == 0 { scaled(*from, INVERSE_GAIN) } else { *from };
            }
        }
    }
}

/// Undoes [`forward`].
pub fn inverse(
    plane: &mut [i32],
    stride: usize,
    (width, height): (usize, usize),
    scratch: &mut Scratch,
) {
    if height > 1 {
        let low = height.div_ceil(2);
        let room = &mut scratch.0[..width * height];
        gather(plane, stride, width, room);
        for (from, values) in room.chunks(width).enumerate() {
            let to = if from < low { 2 * from } else { 2 * (from - low) + 1 };
            let row = &mut plane[to * stride..to * stride + width];
            for (to, value) in row.iter_mut().zip(values) {
                *to = if from < low { scaled(*value, GAIN) } else { *value };
            }
        }
        for (parity, factor) in STEPS.into_iter().rev() {
            lift_rows(plane, stride, (width, height), parity, -factor);
        }
    }
    if width > 1 {
        let (even, odd) = scratch.0[..width].split_at_mut(width.div_ceil(2));
        for row in plane.chunks_mut(stride).take(height) {
            let row = &mut row[..width];
            let (low, high) = row.split_at(even.len());
            for (to, value) in even.iter_mut().zip(low) {
                *to = scaled(*value, GAIN);
            }
            odd.copy_from_slice(high);
            for (parity, factor) in STEPS.into_iter().rev() {
                lift_line(even, odd, parity, -factor);
            }
            for (i, pair) in row.chunks_mut(2).enumerate() {
                pair[0] = even[i];
                pair.get_mut(1).into_iter().for_each(|value| *value = odd[i]);
            }
        }
    }
}

/// Copies the upper left corner of a plane, row by row.
fn gather(plane: &[i32], stride: usize, width: usize, into: &mut [i32]) {
    for (into, row) in into.chunks_mut(width).zip(plane.chunks(stride)) {
        into.copy_from_slice(&row[..width]);
    }
}

/// One lifting step along a row of two or more, given as its even and its odd samples.
fn lift_line(even: &mut [i32], odd: &mut [i32], parity: usize, factor: i32) {
    let is_even_longer = even.len() > odd.len();
    let lift = |to: &mut i32, a: i32, b: i32| {
        *to = to.wrapping_add(scaled(a.wrapping_add(b), factor));
    };
    let (to, from): (&mut [i32], &[i32]) = if parity == 0 {
        // The line is mirrored at its ends.
        lift(&mut even[0], odd[0], odd[0]);
        (&mut even[1..], odd)
    } else {
        (odd, even)
    };
    let others = from.iter().zip(&from[1..]);
    to.iter_mut().zip(others).for_each(|(to, (a, b))| lift(to, *a, *b));
    if is_even_longer == (parity == 0)
        && let (Some(to), Some(last)) = (to.last_mut(), from.last())
    {
        lift(to, *last, *last);
    }
}

/// One lifting step along the columns, for two rows or more.
fn lift_rows(
    plane: &mut [i32],
    stride: usize,
    (width, height): (usize, usize),
    parity: usize,
    factor: i32,
) {
    for y in (parity..height).step_by(2) {
        let (before, after) = neighbours(y, height);
        let (above, rest) = plane.split_at_mut(y * stride);
        let (row, below) = rest.split_at_mut(stride.min(rest.len()));
        let row = &mut row[..width];
        let other = |index: usize| {
            if index < y { &above[index * stride..index * stride + width] } else { &below[..width] }
        };
        for ((to, a), b) in row.iter_mut().zip(other(before)).zip(other(after)) {
            *to = to.wrapping_add(scaled(a.wrapping_add(*b), factor));
        }
    }
}

/// Norms of the lines that a low and a high coefficient of 1 make, after so many levels.
pub(super) fn line_norms(level: usize) -> (f64, f64) {
    (centred_norm(level, false), centred_norm(level, true))
}

/// The norm, with the coefficient amid a line long enough that no end is reached.
fn centred_norm(level: usize, high: bool) -> f64 {
    let mut line = vec![0.0; 32];
    line[16] = 1.0;
    for step in 0..level {
        line = widened(&line, high && step == 0);
    }
    line.iter().map(|v| v * v).sum::<f64>().sqrt()
}

/// One level of the inverse, in floats: `line` as the low band, or as the high one.
fn widened(line: &[f64], high: bool) -> Vec<f64> {
    let scale = f64::from(1 << PLACES);
    let mut wide = vec![0.0; 2 * line.len()];
    for (i, value) in line.iter().enumerate() {
        wide[2 * i + usize::from(high)] =
            if high { *value } else { value * f64::from(GAIN) / scale };
    }
    for (parity, factor) in STEPS.into_iter().rev() {
        for i in (parity..wide.len()).step_by(2) {
            let (before, after) = neighbours(i, wide.len());
            wide[i] -= (wide[before] + wide[after]) * f64::from(factor) / scale;
        }
    }
    wide
}

#[cfg(test)]
mod tests {
    use super::super::geometry::Geometry;
    use super::*;

    fn plane(geometry: &Geometry) -> Vec<i32> {
        let value = |i: usize| ((i * i * 31 + i * 7) % 256) as i32;
        (0..geometry.len()).map(|i| (value(i) - 128) << FRACTION).collect()
    }

    #[test]
    fn the_inverse_gives_the_plane_back_to_a_part_of_a_level() {
        for size in [(1, 1), (1, 9), (2, 2), (6, 1), (7, 13), (320, 180)] {
            let geometry = Geometry::new(size.0, size.1);
            let mut scratch = Scratch::new(geometry.len());
            let before = plane(&geometry);
            let mut after = before.clone();
            for level in 0..geometry.levels {
                forward(&mut after, geometry.width, geometry.sizes[level], &mut scratch);
            }
            for level in (0..geometry.levels).rev() {
                inverse(&mut after, geometry.width, geometry.sizes[level], &mut scratch);
            }
            let worst = before.iter().zip(&after).map(|(a, b)| (a - b).abs()).max();
            assert!(worst < Some(1 << (FRACTION - 2)), "{size:?}: {worst:?}");
        }
    }

    #[test]
    fn the_low_band_keeps_a_flat_picture() {
        let geometry = Geometry::new(64, 48);
        let mut plane = vec![200 << FRACTION; geometry.len()];
        let mut scratch = Scratch::new(geometry.len());
        for level in 0..geometry.levels {
            forward(&mut plane, geometry.width, geometry.sizes[level], &mut scratch);
        }
        let (width, height) = geometry.sizes[geometry.levels];
        for y in 0..height {
            for value in &plane[y * geometry.width..y * geometry.width + width] {
                assert!((value - (200 << FRACTION)).abs() < 1 << (FRACTION - 1), "{value}");
            }
        }
    }

    #[test]
    fn norms_are_those_of_the_pictures() {
        let geometry = Geometry::new(256, 256);
        let mut scratch = Scratch::new(geometry.len());
        for band in geometry.bands() {
            let one = 1 << 16;
            let mut plane = vec![0; geometry.len()];
            plane[band.offset + band.height / 2 * geometry.width + band.width / 2] = one;
            for level in (0..geometry.levels).rev() {
                inverse(&mut plane, geometry.width, geometry.sizes[level], &mut scratch);
            }
            let norm = plane.iter().map(|v| (f64::from(*v) / f64::from(one)).powi(2)).sum::<f64>();
            let ratio = norm.sqrt() / geometry.norm(&band);
            // The coarsest bands reach the picture's edges.
            let off = if band.level > 4 { 0.15 } else { 0.01 };
            assert!((ratio - 1.0).abs() < off, "{band:?}: {ratio}");
        }
    }
}
