//! The coded part of a compact prior: positions along the Morton curve, then the columns.

use super::coder::Coder;
use super::number::{Rising, Signed};
use super::quantise::{COLOUR, LOGIT, ROTATION};

/// Added to the code of a coordinate before its bits are interleaved.
const BIAS: i32 = 1 << 29;

/// Bits of a coordinate on the curve.
const BITS: u32 = 30;

/// Where a position lies on the Morton curve, from its codes of magnitude below 2²⁹.
pub fn rank(code: [i32; 3]) -> u128 {
    let mut rank = 0;
    for place in (0..BITS).rev() {
        for value in code {
            rank = rank << 1 | u128::from((value + BIAS) as u32 >> place & 1);
        }
    }
    rank
}

/// The position of a rank. Bits above the curve's are passed over.
pub fn unrank(rank: u128) -> [i32; 3] {
    std::array::from_fn(|axis| {
        let bit = |place: u32| (rank >> (3 * place + 2 - axis as u32) & 1) as i32;
        (0..BITS).rev().fold(0, |value, place| value << 1 | bit(place)) - BIAS
    })
}

/// Codes ranks, which do not fall. The reader's `ranks` say how many there are.
pub fn code_ranks(coder: &mut impl Coder, ranks: &mut [u128]) {
    let mut model = Rising::new();
    for rank in ranks {
        *rank = model.code(coder, *rank);
    }
}

/// Classes of a magnitude.
const CLASSES: usize = 8;

/// How a column is foretold.
struct Prediction {
    /// Whether values are close to those of the splats before: their differences are coded then.
    local: bool,
    /// Whether the column starts a group: nothing is known about the splats from columns before.
    first: bool,
}

impl Prediction {
    fn of(column: usize) -> Prediction {
        Prediction {
            local: !(ROTATION..LOGIT).contains(&column) && column < COLOUR + 3,
            first: [0, ROTATION, LOGIT, COLOUR, COLOUR + 3].contains(&column),
        }
    }
}

/// Codes the columns, one after the other; `columns` have the length of the prior.
///
/// The context of a number is how large the numbers before it in its column are, and how large those
/// of the same splat in the columns before.
pub fn code_columns(coder: &mut impl Coder, columns: &mut [Vec<i32>]) {
    let mut across = vec![0_u32; columns.first().map_or(0, Vec::len)];
    for (index, column) in columns.iter_mut().enumerate() {
        let prediction = Prediction::of(index);
        if prediction.first {
            across.fill(0);
        }
        code_column(coder, column, &mut across, &prediction);
    }
}

fn code_column(
    coder: &mut impl Coder,
    column: &mut [i32],
    across: &mut [u32],
    prediction: &Prediction,
) {
    let mut models = vec![Signed::NEW; CLASSES * CLASSES];
    let (mut mean, mut along) = (0_i64, 0_u32);
    for (value, across) in column.iter_mut().zip(across) {
        let guess = if prediction.local { (mean >> 8) as i32 } else { 0 };
        let context = class(along) * CLASSES + class(*across);
        let rest = models[context].code(coder, value.wrapping_sub(guess));
        *value = guess.wrapping_add(rest);
        mean += ((i64::from(*value) << 8) - mean) / 8;
        let size = rest.unsigned_abs().min(1 << 20) * 16;
        along = (7 * along + size) / 8;
        *across = (*across + size) / 2;
    }
}

/// The class of a mean magnitude, given in sixteenths.
fn class(magnitude: u32) -> usize {
    let length = (u32::BITS - magnitude.leading_zeros()) as usize;
    length.saturating_sub(2).min(CLASSES - 1)
}
