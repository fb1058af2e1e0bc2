//! Splats in steps as byte planes: positions along the Morton curve, then the columns.

/// Added to the code of a coordinate before its bits are interleaved.
const BIAS: i32 = 1 << 29;

/// Bits of a coordinate on the curve.
const BITS: u32 = 30;

/// Bytes of a step along the curve, and of a number in a column.
const RANK_BYTES: usize = 12;
const NUMBER_BYTES: usize = 4;

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

/// The position of a rank. Bits above the curve's are ignored.
pub fn unrank(rank: u128) -> [i32; 3] {
    std::array::from_fn(|axis| {
        let bit = |place: u32| (rank >> (3 * place + 2 - axis as u32) & 1) as i32;
        (0..BITS).rev().fold(0, |value, place| value << 1 | bit(place)) - BIAS
    })
}

/// The planes of ranks, which do not fall, and columns of as many numbers.
pub fn planes(ranks: &[u128], columns: &[Vec<i32>]) -> Vec<u8> {
    let mut planes = Vec::with_capacity(size(ranks.len(), columns.len()));
    let before = std::iter::once(&0).chain(ranks);
    let steps: Vec<u128> = ranks.iter().zip(before).map(|(rank, before)| rank - before).collect();
    for byte in 0..RANK_BYTES {
        planes.extend(steps.iter().map(|step| (step >> (8 * byte)) as u8));
    }
    for column in columns {
        for byte in 0..NUMBER_BYTES {
            planes.extend(column.iter().map(|v| (fold_sign(*v) >> (8 * byte)) as u8));
        }
    }
    planes
}

/// The `count` ranks and as many numbers of each column.
pub fn numbers(planes: &[u8], count: usize) -> (Vec<u128>, Vec<Vec<i32>>) {
    let (steps, numbers) = planes.split_at(RANK_BYTES * count);
    let mut rank = 0_u128;
    let ranks = (0..count).map(|i| {
        let step = steps[i..].iter().step_by(count).rev();
        rank = rank.saturating_add(step.fold(0, |value, byte| value << 8 | u128::from(*byte)));
        rank
    });
    let ranks = ranks.collect();
    let columns = numbers.chunks_exact(NUMBER_BYTES * count).map(|column| {
        let number = |i: usize| {
            let bytes = std::array::from_fn(|byte| column[byte * count + i]);
            unfold_sign(u32::from_le_bytes(bytes))
        };
        (0..count).map(number).collect()
    });
    (ranks, columns.collect())
}

/// Bytes of all planes.
pub fn size(count: usize, columns: usize) -> usize {
    count * (RANK_BYTES + NUMBER_BYTES * columns)
}

/// 0, −1, 1, −2, … as 0, 1, 2, 3, …
fn fold_sign(value: i32) -> u32 {
    ((value << 1) ^ (value >> 31)) as u32
}

fn unfold_sign(value: u32) -> i32 {
    (value >> 1) as i32 ^ -((value & 1) as i32)
}
