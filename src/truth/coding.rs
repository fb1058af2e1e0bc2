//! Marks as bits.

use crate::range_coder::{Bits, Probability};

use super::marks::{Mark, Marks};
use super::table::{OFF, TAKES, WRONG};

/// Which chances a cell's bits have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Contexts {
    pub off: usize,
    pub wrong: usize,
    pub takes: usize,
}

/// The contexts of a cell, from the cells before it and those of the key map.
pub fn contexts(now: &Marks, before: Option<&Marks>, column: usize, row: usize) -> Contexts {
    let (x, y) = (column as isize, row as isize);
    let [left, above] = [now.at(x - 1, y), now.at(x, y - 1)];
    let [above_left, above_right] = [now.at(x - 1, y - 1), now.at(x + 1, y - 1)];
    let off = |mark: Mark| usize::from(mark.is_off());
    let around = off(left) + 2 * off(above) + 4 * off(above_left) + 8 * off(above_right);
    let level = |mark: Mark| match mark {
        Mark::Rendered => 0,
        Mark::Mended => 1,
        Mark::Differs | Mark::Wrong => 2,
    };
    let wrong = |mark: Mark| usize::from(mark == Mark::Wrong);
    let (then_off, then_wrong, then_level) = match before {
        None => (0, 0, 0),
        Some(before) => {
            let same = before.at(x, y);
            let near = [(-1, 0), (1, 0), (0, -1), (0, 1)];
            let near: usize = near.iter().map(|(u, v)| off(before.at(x + u, y + v))).sum();
            (1 + 4 * off(same) + near.min(3), 1 + off(same) + wrong(same), 1 + level(same))
        }
    };
    Contexts {
        off: 16 * then_off + around,
        wrong: 3 * then_wrong + wrong(left) + wrong(above),
        takes: 9 * then_level + 3 * level(left) + level(above),
    }
}

/// Codes all cells of a map. A writer finds their marks in `cells`; a reader puts them there. `before`: those of the
/// map that it is predicted from. `whole`: it tells no cell that the render shows from one that the difference picture
/// mends.
pub fn code(coder: &mut impl Bits, whole: bool, before: Option<&Marks>, cells: &mut Marks) {
    for row in 0..cells.rows {
        for column in 0..cells.columns {
            let index = row * cells.columns + column;
            let at = contexts(cells, before, column, row);
            cells.marks[index] = code_mark(coder, whole, at, cells.marks[index]);
        }
    }
}

/// Codes a cell's mark, and returns it.
pub fn code_mark(coder: &mut impl Bits, whole: bool, at: Contexts, known: Mark) -> Mark {
    let mut bit = |one: Probability, known: bool| coder.bit(one, known);
    if bit(OFF[at.off], known.is_off()) {
        let wrong = bit(WRONG[at.wrong], known == Mark::Wrong);
        return if wrong { Mark::Wrong } else { Mark::Differs };
    }
    if whole || bit(TAKES[at.takes], known == Mark::Mended) { Mark::Mended } else { Mark::Rendered }
}
