//! Pictures at places between their pixels.

use crate::Picture;

use super::lifting::FRACTION;

/// Places between two pixels that are told apart.
pub const PLACES: usize = 64;
/// Binary places of the weights.
const WEIGHT_PLACES: u32 = 9;
/// Weights of the four pixels around a place between the second and the third (Catmull and Rom's cubic).
const WEIGHTS: [[i32; 4]; PLACES] = weights();
/// A difference picture's value for no difference.
pub const NONE: i32 = 128;

/// A place along both axes: a whole pixel, and 64ths beyond it.
pub struct SubPixel {
    pub column: (isize, usize),
    pub row: (isize, usize),
}

impl SubPixel {
    /// The place of a pixel that is moved to the right and down, in `parts` of a pixel.
    pub fn displaced([x, y]: [usize; 2], by: [i16; 2], parts: i16) -> SubPixel {
        let place = |at: usize, by: i16| {
            let places = by.rem_euclid(parts) as usize * (PLACES / parts as usize);
            (at as isize + isize::from(by.div_euclid(parts)), places)
        };
        SubPixel { column: place(x, by[0]), row: place(y, by[1]) }
    }
}

const fn weights() -> [[i32; 4]; PLACES] {
    let one = PLACES as i64;
    // Numerators of the cubic, over 2 · 64³; in binary places of the weight that is divided by this.
    let divisor = (2 * one * one * one) >> WEIGHT_PLACES;
    let mut table = [[0; 4]; PLACES];
    let mut f = 0;
    while f < PLACES {
        let t = f as i64;
        let cubic = [
            ((-t + 2 * one) * t - one * one) * t,
            ((3 * t - 5 * one) * t) * t + 2 * one * one * one,
            ((-3 * t + 4 * one) * t + one * one) * t,
            ((t - one) * t) * t,
        ];
        let mut k = 0;
        let mut sum = 0;
        while k < 4 {
            table[f][k] = (cubic[k] + divisor / 2).div_euclid(divisor) as i32;
            sum += table[f][k];
            k += 1;
        }
        // What rounding left, to the nearer pixel.
        table[f][if 2 * f < PLACES { 1 } else { 2 }] += (1 << WEIGHT_PLACES) - sum;
        f += 1;
    }
    table
}

/// How far a picture is from [`NONE`] at a place, in [`FRACTION`] binary places.
pub fn sample(picture: &Picture, place: &SubPixel) -> [i32; 3] {
    let (width, height) = (picture.width as isize, picture.height as isize);
    let ((column, x), (row, y)) = (place.column, place.row);
    let inside = column >= 1 && column + 2 < width;
    let mut sums = [0; 3];
    for (k, down) in WEIGHTS[y].into_iter().enumerate() {
        let row = (row - 1 + k as isize).clamp(0, height - 1) * width;
        let mut along = [0; 3];
        let mut add = |pixel: &[u8], weight: i32| {
            for (sum, value) in along.iter_mut().zip(pixel) {
                *sum += weight * (i32::from(*value) - NONE);
            }
        };
        if inside {
            let from = &picture.data[3 * (row + column - 1) as usize..][..12];
            for (pixel, weight) in from.as_chunks::<3>().0.iter().zip(WEIGHTS[x]) {
                add(pixel, weight);
            }
        } else {
            for (i, weight) in WEIGHTS[x].into_iter().enumerate() {
                let column = (column - 1 + i as isize).clamp(0, width - 1);
                add(&picture.data[3 * (row + column) as usize..][..3], weight);
            }
        }
        for (sum, along) in sums.iter_mut().zip(along) {
            *sum += down * along;
        }
    }
    const SPARE: u32 = 2 * WEIGHT_PLACES - FRACTION;
    sums.map(|sum| (sum + (1 << (SPARE - 1))) >> SPARE)
}

/// A plane's value at a place, rounded.
pub fn brightness_at(plane: &[u8], (width, height): (usize, usize), place: &SubPixel) -> i64 {
    let ((column, x), (row, y)) = (place.column, place.row);
    let at = |index: isize, len: usize| index.clamp(0, len as isize - 1) as usize;
    let along = |row: usize| {
        let row = &plane[row * width..][..width];
        if x == 0 {
            return i32::from(row[at(column, width)]) << WEIGHT_PLACES;
        }
        let pixels = (0..4).map(|i| i32::from(row[at(column - 1 + i, width)]));
        pixels.zip(WEIGHTS[x]).map(|(pixel, weight)| pixel * weight).sum()
    };
    let sum = if y == 0 {
        along(at(row, height)) << WEIGHT_PLACES
    } else {
        (0..4).zip(WEIGHTS[y]).map(|(k, down)| down * along(at(row - 1 + k, height))).sum()
    };
    i64::from((sum + (1 << (2 * WEIGHT_PLACES - 1))) >> (2 * WEIGHT_PLACES))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_sum_to_one() {
        for weights in WEIGHTS {
            assert_eq!(weights.iter().sum::<i32>(), 1 << WEIGHT_PLACES);
        }
        assert_eq!(WEIGHTS[0], [0, 512, 0, 0]);
        assert_eq!(WEIGHTS[32], [-32, 288, 288, -32]);
    }
}
