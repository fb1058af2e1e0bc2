//! The 9/7 wavelet (Cohen, Daubechies, Feauveau) by lifting, in integers.
//!
//! The low band keeps the mean of the picture: a flat picture's low band has its value at every level. The
//! high band is as the lifting steps leave it. Sums wrap around, so that damaged input gives a picture, whatever
//! it shows; pictures of 8 bits in [`FRACTION`] binary places stay far from that.

use std::ops::Range;

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

/// Columns that are lifted side by side: as many as processors load at a time, and few enough that all their rows stay
/// near the processor.
const STRIP: usize = 32;

/// Room for a row, or for the columns of a strip.
pub struct Scratch(Vec<i32>);

impl Scratch {
    /// For planes of a size.
    pub fn new(width: usize, height: usize) -> Scratch {
        Scratch(vec![0; width.max(STRIP * height)])
    }

    /// Room for the even and the odd samples of a line, each of them of `N` lines.
    fn line<const N: usize>(&mut self, len: usize) -> (&mut [[i32; N]], &mut [[i32; N]]) {
        let (line, _) = self.0.as_chunks_mut();
        line[..len].split_at_mut(len.div_ceil(2))
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
        let (even, odd) = scratch.line::<1>(width);
        for row in plane.chunks_mut(stride).take(height) {
            let (pairs, last) = row[..width].as_chunks::<2>();
            for ((pair, even), odd) in pairs.iter().zip(&mut *even).zip(&mut *odd) {
                (*even, *odd) = ([pair[0]], [pair[1]]);
            }
            even[pairs.len()..].as_flattened_mut().copy_from_slice(last);
            analyse(even, odd);
            let (low, high) = row[..width].split_at_mut(even.len());
            low.copy_from_slice(even.as_flattened());
            high.copy_from_slice(odd.as_flattened());
        }
    }
    if height > 1 {
        let (even, odd) = scratch.line::<STRIP>(height);
        for columns in strips(width) {
            let rows = plane.chunks(stride).take(height);
            for (y, row) in rows.map(|row| &row[columns.clone()]).enumerate() {
                let line = if y % 2 == 0 { &mut even[y / 2] } else { &mut odd[y / 2] };
                copy(&mut line[..row.len()], row);
            }
            analyse(even, odd);
            let rows = plane.chunks_mut(stride).map(|row| &mut row[columns.clone()]);
            for (row, line) in rows.zip(even.iter().chain(&*odd)) {
                copy(row, &line[..row.len()]);
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
        let (even, odd) = scratch.line::<STRIP>(height);
        for columns in strips(width) {
            let rows = plane.chunks(stride).map(|row| &row[columns.clone()]);
            for (row, line) in rows.zip(even.iter_mut().chain(&mut *odd)) {
                copy(&mut line[..row.len()], row);
            }
            synthesise(even, odd);
            let rows = plane.chunks_mut(stride).take(height);
            for (y, row) in rows.map(|row| &mut row[columns.clone()]).enumerate() {
                let line = if y % 2 == 0 { &even[y / 2] } else { &odd[y / 2] };
                copy(row, &line[..row.len()]);
            }
        }
    }
    if width > 1 {
        let (even, odd) = scratch.line::<1>(width);
        for row in plane.chunks_mut(stride).take(height) {
            let (low, high) = row[..width].split_at(even.len());
            even.as_flattened_mut().copy_from_slice(low);
            odd.as_flattened_mut().copy_from_slice(high);
            synthesise(even, odd);
            let (pairs, last) = row[..width].as_chunks_mut::<2>();
            last.copy_from_slice(even[pairs.len()..].as_flattened());
            for ((pair, [even]), [odd]) in pairs.iter_mut().zip(&*even).zip(&*odd) {
                *pair = [*even, *odd];
            }
        }
    }
}

/// The columns of a picture, strip by strip.
fn strips(width: usize) -> impl Iterator<Item = Range<usize>> {
    (0..width).step_by(STRIP).map(move |first| first..(first + STRIP).min(width))
}

/// Copies a row of a strip. Most strips have all their columns, which are copied faster.
fn copy(to: &mut [i32], from: &[i32]) {
    match (to.as_chunks_mut::<STRIP>().0, from.as_chunks::<STRIP>().0) {
        ([to], [from]) => *to = *from,
        _ => to.copy_from_slice(from),
    }
}

/// Divides a line of two or more, given as its even and its odd samples, into its low and its high half.
fn analyse<const N: usize>(even: &mut [[i32; N]], odd: &mut [[i32; N]]) {
    for (parity, factor) in STEPS {
        lift(even, odd, parity, factor);
    }
    even.as_flattened_mut().iter_mut().for_each(|value| *value = scaled(*value, INVERSE_GAIN));
}

/// Undoes [`analyse`].
fn synthesise<const N: usize>(even: &mut [[i32; N]], odd: &mut [[i32; N]]) {
    even.as_flattened_mut().iter_mut().for_each(|value| *value = scaled(*value, GAIN));
    for (parity, factor) in STEPS.into_iter().rev() {
        lift(even, odd, parity, -factor);
    }
}

/// One lifting step along a line of two or more.
fn lift<const N: usize>(even: &mut [[i32; N]], odd: &mut [[i32; N]], parity: usize, factor: i32) {
    let is_even_longer = even.len() > odd.len();
    let lift = |to: &mut [i32; N], a: &[i32; N], b: &[i32; N]| {
        for ((to, a), b) in to.iter_mut().zip(a).zip(b) {
            *to = to.wrapping_add(scaled(a.wrapping_add(*b), factor));
        }
    };
    let (to, from): (&mut [[i32; N]], &[[i32; N]]) = if parity == 0 {
        // The line is mirrored at its ends.
        lift(&mut even[0], &odd[0], &odd[0]);
        (&mut even[1..], odd)
    } else {
        (odd, even)
    };
    let others = from.iter().zip(&from[1..]);
    to.iter_mut().zip(others).for_each(|(to, (a, b))| lift(to, a, b));
    if is_even_longer == (parity == 0)
        && let (Some(to), Some(last)) = (to.last_mut(), from.last())
    {
        lift(to, last, last);
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

/// Index of a line's neighbours, mirrored at its ends.
fn neighbours(index: usize, len: usize) -> (usize, usize) {
    let before = if index == 0 { 1 } else { index - 1 };
    let after = if index + 1 < len { index + 1 } else { index - 1 };
    (before, after)
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
        for size in [(1, 1), (1, 9), (2, 2), (6, 1), (7, 13), (65, 43), (320, 180)] {
            let geometry = Geometry::new(size.0, size.1);
            let mut scratch = Scratch::new(geometry.width, geometry.height);
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
        let mut scratch = Scratch::new(geometry.width, geometry.height);
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
        let mut scratch = Scratch::new(geometry.width, geometry.height);
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
