//! What the lanes of a subgroup do together.

use crate::program::{Collective, Part};

/// A lane that takes part, and its operands.
#[derive(Clone, Copy)]
pub struct Lane {
    pub number: u32,
    pub a: u32,
    pub b: u32,
}

/// The result of each lane, in their order: four words of a ballot, one of anything else.
///
/// # Errors
/// The place in `lanes` of the one that asks for a value of a lane that takes no part, and that lane's number.
pub fn together(
    op: Collective,
    lanes: &[Lane],
    in_turn: bool,
) -> Result<Vec<[u32; 4]>, (usize, u32)> {
    let word = |word: u32| [word, 0, 0, 0];
    let all = |result: [u32; 4]| Ok(vec![result; lanes.len()]);
    match op {
        Collective::All => all(word(lanes.iter().all(|lane| lane.a != 0).into())),
        Collective::Any => all(word(lanes.iter().any(|lane| lane.a != 0).into())),
        Collective::Ballot => {
            let mut bits = [0; 4];
            for lane in lanes.iter().filter(|lane| lane.a != 0) {
                bits[lane.number as usize / 32] |= 1 << (lane.number % 32);
            }
            all(bits)
        }
        Collective::Shuffle => {
            let from = |(at, lane): (usize, &Lane)| {
                let other = lanes.iter().find(|other| other.number == lane.b);
                other.map(|other| word(other.a)).ok_or((at, lane.b))
            };
            lanes.iter().enumerate().map(from).collect()
        }
        Collective::IntegerSum(part) => {
            Ok(sums(lanes, part, 0, u32::wrapping_add).into_iter().map(word).collect())
        }
        Collective::FloatSum(Part::All) if !in_turn => {
            let mut values: Vec<u32> = lanes.iter().map(|lane| lane.a).collect();
            while values.len() > 1 {
                let add = |pair: &[u32]| pair.iter().copied().reduce(add_floats).unwrap_or(0);
                values = values.chunks(2).map(add).collect();
            }
            all(word(values[0]))
        }
        Collective::FloatSum(part) => {
            Ok(sums(lanes, part, 0, add_floats).into_iter().map(word).collect())
        }
    }
}

fn add_floats(a: u32, b: u32) -> u32 {
    (f32::from_bits(a) + f32::from_bits(b)).to_bits()
}

/// The sums of the lanes, one after the other.
fn sums(lanes: &[Lane], part: Part, zero: u32, add: fn(u32, u32) -> u32) -> Vec<u32> {
    let mut sum = zero;
    let mut sums = Vec::new();
    for lane in lanes {
        let before = sum;
        sum = add(sum, lane.a);
        sums.push(if part == Part::BeforeThis { before } else { sum });
    }
    if part == Part::All {
        sums.fill(sum);
    }
    sums
}
