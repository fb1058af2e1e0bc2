//! Which marks a map says: as many bytes less as saying more than what is true is worth.

use crate::range_coder::{Bits, Probability};

use super::coding::{code, code_mark, contexts};
use super::marks::{Mark, Marks};

const MARKS: [Mark; 4] = [Mark::Rendered, Mark::Mended, Mark::Differs, Mark::Wrong];

/// What it costs to say that the difference picture mends a block that the render shows: that counts only if a packet
/// is cut.
pub const MENDED_HARM: f32 = 0.1;

/// What it costs to say a mark of a block that has another, by what is true, then by what is said. `None`: never said.
///
/// The unit is a block that is as seen, and is said to differ.
const HARM: [[Option<f32>; 4]; 4] = [
    [Some(0.0), Some(MENDED_HARM), Some(1.0), Some(2.0)],
    [None, Some(0.0), Some(1.0), Some(2.0)],
    [None, None, Some(0.0), Some(1.0)],
    [None, None, None, Some(0.0)],
];

/// Counts bits.
struct Cost(f32);

impl Bits for Cost {
    fn bit(&mut self, one: Probability, bit: bool) -> bool {
        let chance = f32::from(one) / 65_536.0;
        // The platform's own logarithm may round otherwise, and packets be other ones there.
        self.0 -= libm::log2f(if bit { chance } else { 1.0 - chance });
        bit
    }
}

/// Chooses the marks of cells, in memory of its own.
pub struct Choice {
    /// What is said.
    pub cells: Marks,
    /// The cells of the key map.
    before: Marks,
    /// What each mark of each cell does harm; infinite: it may not be said.
    harms: Vec<[f32; 4]>,
}

impl Choice {
    pub fn new(marks: &Marks) -> Choice {
        let harms = Vec::with_capacity(marks.marks.len());
        Choice { cells: marks.clone(), before: marks.clone(), harms }
    }

    /// Takes what is true, and the map that this one is predicted from, to cells of `side` blocks a side.
    pub fn prepare(&mut self, truth: &Marks, before: &Marks, side: usize) {
        self.cells.set_cells_of(truth, side);
        self.before.set_cells_of(before, side);
        self.harms.clear();
        self.harms.resize(self.cells.marks.len(), [0.0; 4]);
        for (index, mark) in truth.marks.iter().enumerate() {
            let (column, row) = (index % truth.columns / side, index / truth.columns / side);
            let harms = &mut self.harms[row * self.cells.columns + column];
            for (sum, harm) in harms.iter_mut().zip(HARM[*mark as usize]) {
                *sum += harm.unwrap_or(f32::INFINITY);
            }
        }
    }

    /// Codes what was chosen.
    pub fn code(&mut self, coder: &mut impl Bits, whole: bool, is_predicted: bool) {
        code(coder, whole, is_predicted.then_some(&self.before), &mut self.cells);
    }

    /// Chooses for each cell, one after the other, what costs the fewest bits; harm of one unit costs `price` bits.
    /// Returns the harm.
    pub fn choose(&mut self, whole: bool, is_predicted: bool, price: f32) -> f32 {
        let mut sum = 0.0;
        for (index, harms) in self.harms.iter().enumerate() {
            let (column, row) = (index % self.cells.columns, index / self.cells.columns);
            let before = is_predicted.then_some(&self.before);
            let at = contexts(&self.cells, before, column, row);
            let cost = |mark: Mark| {
                let mut bits = Cost(price * harms[mark as usize]);
                code_mark(&mut bits, whole, at, mark);
                bits.0
            };
            let marks = if whole { &MARKS[1..] } else { &MARKS[..] };
            let cheapest = marks.iter().copied().min_by(|a, b| cost(*a).total_cmp(&cost(*b)));
            let mark = cheapest.unwrap_or(Mark::Wrong);
            self.cells.marks[index] = mark;
            sum += harms[mark as usize];
        }
        sum
    }
}
