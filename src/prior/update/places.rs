//! Positions as a tree of boxes: how many of a box's splats lie in its upper half, box by box.
//!
//! The order of the splats tells nothing, so it costs nothing: they come back in the order of the tree, which is that
//! of the Morton curve.

use crate::adaptive_numbers::Magnitude;
use crate::range_coder::Bits;
use crate::range_coder::Probability;

/// Sorts splats into the order of the tree.
pub fn sort<T>(splats: &mut [T], position: impl Fn(&T) -> [i32; 3]) {
    let least = least(splats.iter().map(&position));
    splats.sort_by_cached_key(|splat| rank(above(position(splat), least)));
}

fn least(positions: impl Iterator<Item = [i32; 3]>) -> [i32; 3] {
    positions.reduce(|a, b| std::array::from_fn(|axis| a[axis].min(b[axis]))).unwrap_or_default()
}

/// A position above the least one.
fn above(position: [i32; 3], least: [i32; 3]) -> [u32; 3] {
    std::array::from_fn(|axis| position[axis].wrapping_sub(least[axis]) as u32)
}

/// Where a position lies on the Morton curve.
fn rank(position: [u32; 3]) -> u128 {
    let digits = (0..32).rev().flat_map(|place| position.map(move |value| value >> place & 1));
    digits.fold(0, |rank, digit| rank << 1 | u128::from(digit))
}

/// Codes positions. A writer's are sorted; a reader's are put in place of any others.
pub fn code(coder: &mut impl Bits, positions: &mut [[i32; 3]]) {
    let least = least(positions.iter().copied());
    let mut numbers = Magnitude::new();
    let least = least.map(|value| unfold(numbers.code(coder, fold(value))));
    let mut points: Vec<[u32; 3]> = positions.iter().map(|p| above(*p, least)).collect();
    let mut numbers = Magnitude::new();
    let size = [0, 1, 2].map(|axis| {
        let largest = points.iter().map(|point| point[axis]).max().unwrap_or(0);
        numbers.code(coder, largest)
    });
    let mut tree = Tree { coder, size, sums: Vec::new() };
    tree.cell(Cell { least: [0; 3], place: 95 }, &mut points);
    for (position, point) in positions.iter_mut().zip(points) {
        *position = std::array::from_fn(|axis| least[axis].wrapping_add(point[axis] as i32));
    }
}

/// 0, −1, 1, −2, … as 0, 1, 2, 3, …
pub fn fold(value: i32) -> u32 {
    ((value << 1) ^ (value >> 31)) as u32
}

pub fn unfold(value: u32) -> i32 {
    (value >> 1) as i32 ^ -((value & 1) as i32)
}

/// A box of the tree.
#[derive(Clone, Copy)]
struct Cell {
    least: [u32; 3],
    /// Three times the binary place by which it is divided, and the axis from z to x. Below zero: it is one position.
    place: i32,
}

struct Tree<'a, B> {
    coder: &'a mut B,
    /// Largest position on each axis.
    size: [u32; 3],
    /// Sums of the weights of the counts below each one.
    sums: Vec<f64>,
}

impl<B: Bits> Tree<'_, B> {
    fn cell(&mut self, mut cell: Cell, points: &mut [[u32; 3]]) {
        if points.is_empty() {
            return;
        }
        if cell.place < 0 {
            points.fill(cell.least);
            return;
        }
        let (axis, half) = (2 - cell.place as usize % 3, 1 << (cell.place / 3));
        let mut upper = cell.least;
        upper[axis] |= half;
        cell.place -= 1;
        // The tree may end before the upper half begins.
        let Some(beyond) = self.size[axis].checked_sub(upper[axis]) else {
            return self.cell(cell, points);
        };
        let share = f64::from(beyond.saturating_add(1).min(half));
        let share = share / (share + f64::from(half));
        let count = points.len();
        let below = points.partition_point(|point| point[axis] & half == 0);
        let below = count - self.count(share, count, count - below);
        let (lower, higher) = points.split_at_mut(below);
        self.cell(cell, lower);
        self.cell(Cell { least: upper, ..cell }, higher);
    }

    /// Codes how many of `total` splats lie in a half that has this share of a box.
    fn count(&mut self, share: f64, total: usize, above: usize) -> usize {
        let spread = SPREAD;
        let (up, down) = (spread * share, spread * (1.0 - share));
        self.sums.clear();
        let (mut weight, mut sum) = (1.0, 0.0);
        self.sums.push(0.0);
        for k in 0..=total {
            sum += weight;
            self.sums.push(sum);
            let (k, left) = (k as f64, (total - k) as f64);
            weight *= left * (k + up) / ((k + 1.0) * (left - 1.0 + down));
        }
        let (mut least, mut most) = (0, total);
        while least < most {
            let middle = (least + most) / 2;
            let whole = self.sums[most + 1] - self.sums[least];
            let one = (self.sums[most + 1] - self.sums[middle + 1]) / whole * 65_536.0;
            let one = one.clamp(f64::from(SURE), 65_536.0 - f64::from(SURE)) as Probability;
            if self.coder.bit(one, above > middle) {
                least = middle + 1;
            } else {
                most = middle;
            }
        }
        least
    }
}

/// How evenly splats lie: 0 if all of a box lie in one half, very large if each one lies anywhere. Measured.
const SPREAD: f64 = 3.0;
/// No chance comes closer to 0 or 1, parts of 65,536.
const SURE: u16 = 64;

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::range_coder::RangeEncoder;
    use crate::range_coder::WholeReader;

    fn written(positions: &[[i32; 3]]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = RangeEncoder::new(&mut bytes, usize::MAX);
        code(&mut encoder, &mut positions.to_vec());
        encoder.finish();
        bytes
    }

    fn positions() -> impl Strategy<Value = Vec<[i32; 3]>> {
        let near = proptest::array::uniform3(-9_i32..9);
        let position =
            prop_oneof![near, any::<[i32; 3]>(), Just([i32::MIN; 3]), Just([i32::MAX; 3])];
        proptest::collection::vec(position, 0..60)
    }

    proptest! {
        #[test]
        fn positions_come_back_in_the_order_of_the_tree(positions in positions()) {
            let mut sorted = positions.clone();
            sort(&mut sorted, |position| *position);
            let bytes = written(&sorted);
            let mut read = vec![[0; 3]; sorted.len()];
            code(&mut WholeReader::new(&bytes), &mut read);
            prop_assert_eq!(&read, &sorted);
            let mut whole = positions;
            whole.sort_unstable();
            sorted.sort_unstable();
            prop_assert_eq!(whole, sorted);
        }
    }

    #[test]
    fn one_of_two_halves_is_one_bit() {
        // The corners of a box of 256 steps, and one splat anywhere in it.
        let box_of = |middle: &[i32; 3]| {
            let mut positions = vec![[0; 3], *middle, [255; 3]];
            sort(&mut positions, |position| *position);
            written(&positions).len()
        };
        assert!(box_of(&[77, 130, 201]) <= 16);
        // A box that is flat has no bits across.
        let flat: Vec<[i32; 3]> = (0..64).map(|x| [x, 0, 5]).collect();
        assert!(written(&flat).len() <= 20, "{}", written(&flat).len());
    }
}
