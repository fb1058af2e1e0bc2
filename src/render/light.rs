//! Brings the light of a frame to the prior's before the two are compared, and says which of the frame's pixels count.
//! Only searches use it: the difference that is sent is taken from the frame as it is.

use crate::shared::{CELL, LIGHT, MASKED};

/// One light for the whole frame: `factor · value + summand`, by channel, of values in [0, 1].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Correction {
    /// For R, G and B.
    pub factor: [f32; 3],
    /// For R, G and B.
    pub summand: [f32; 3],
}

impl Correction {
    /// The one that changes nothing.
    pub const NONE: Correction = Correction { factor: [1.0; 3], summand: [0.0; 3] };

    /// A value of a channel, corrected.
    pub fn of(&self, channel: usize, value: f32) -> f32 {
        self.factor[channel] * value + self.summand[channel]
    }

    /// A gray value, corrected as the channels are on average.
    pub fn mean(&self, value: f64) -> f64 {
        let mean = |of: &[f32; 3]| of.iter().map(|v| f64::from(*v)).sum::<f64>() / 3.0;
        mean(&self.factor) * value + mean(&self.summand)
    }
}

/// A square of 16×16 pixels of the frame.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Cell {
    /// At the cell's middle, after the [`Correction`]; between middles it is interpolated.
    pub factor: f32,
    /// As `factor`.
    pub summand: f32,
    /// 1 if the cell's pixels count; 0 if they do not.
    pub counts: f32,
}

impl Cell {
    /// The one that changes nothing.
    pub const NONE: Cell = Cell { factor: 1.0, summand: 0.0, counts: 1.0 };
}

/// A flat-field correction: for light that differs from place to place (a vignette, a lamp). It also masks what must
/// not count, such as an object that the prior does not know.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FlatField {
    columns: usize,
    rows: usize,
    cells: Vec<Cell>,
    on: bool,
}

impl FlatField {
    /// Makes one for frames of a size in pixels. It is switched off.
    pub fn new(width: usize, height: usize) -> FlatField {
        let (columns, rows) = (width / CELL as usize, height / CELL as usize);
        FlatField { columns, rows, cells: vec![Cell::NONE; columns * rows], on: false }
    }

    /// Cells per row, and rows. The rest of the frame belongs to the last cells.
    pub fn size(&self) -> [usize; 2] {
        [self.columns, self.rows]
    }

    /// Row by row.
    pub fn cells(&self) -> &[Cell] {
        &self.cells
    }

    /// Row by row; it is on from here on, if there are cells.
    pub fn set(&mut self) -> &mut [Cell] {
        self.on = !self.cells.is_empty();
        &mut self.cells
    }

    /// Switches the correction off.
    pub fn switch_off(&mut self) {
        self.on = false;
    }

    /// Whether it changes anything.
    pub fn is_on(&self) -> bool {
        self.on
    }

    /// What stage `pyramid` reads: the correction, the number of cells, the cells.
    pub(super) fn floats(&self, correction: &Correction, into: &mut Vec<f32>) {
        let [columns, rows] = if self.on { self.size() } else { [0, 0] };
        into.clear();
        into.extend(correction.factor.iter().chain(&correction.summand));
        into.extend([columns as f32, rows as f32]);
        into.extend_from_slice(bytemuck::cast_slice(&self.cells));
    }

    /// Floats of [`floats`](Self::floats).
    pub(super) fn room(&self) -> usize {
        LIGHT as usize + 3 * self.cells.len()
    }

    /// Corrects R, G and B of a pixel whose middle lies at `(x, y)`, pixels of the frame; `None` if it does not count.
    /// The twin of stage `pyramid`.
    pub fn of(&self, rgb: [f32; 3], x: f32, y: f32) -> Option<[f32; 3]> {
        if !self.on {
            return Some(rgb);
        }
        let (u, v) = (x / CELL as f32, y / CELL as f32);
        if self.at(v as usize, u as usize).counts == 0.0 {
            return None;
        }
        let (u, v) = ((u - 0.5).max(0.0), (v - 0.5).max(0.0));
        let (column, row) = (u as usize, v as usize);
        let (across, down) = (u - column as f32, v - row as f32);
        let between = |of: fn(&Cell) -> f32| {
            let along = |row| {
                let [left, right] = [column, column + 1].map(|column| of(self.at(row, column)));
                left * (1.0 - across) + right * across
            };
            along(row) * (1.0 - down) + along(row + 1) * down
        };
        let (factor, summand) = (between(|cell| cell.factor), between(|cell| cell.summand));
        Some(rgb.map(|value| value * factor + summand))
    }

    fn at(&self, row: usize, column: usize) -> &Cell {
        &self.cells[row.min(self.rows - 1) * self.columns + column.min(self.columns - 1)]
    }
}

/// Whether a pixel of a level counts, by its first value.
pub fn counts(value: f32) -> bool {
    value > MASKED
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_off_or_flat_changes_nothing() {
        let mut field = FlatField::new(70, 40);
        let rgb = [0.1, 0.2, 0.3];
        assert_eq!((field.size(), field.of(rgb, 3.5, 3.5)), ([4, 2], Some(rgb)));
        field.set();
        assert!(field.is_on());
        assert_eq!(field.of(rgb, 69.5, 39.5), Some(rgb));
        let mut none = FlatField::new(15, 40);
        assert!(none.set().is_empty() && !none.is_on());
        assert_eq!(none.of(rgb, 1.0, 1.0), Some(rgb));
    }

    #[test]
    fn light_is_interpolated_and_what_does_not_count_is_left_out() {
        let mut field = FlatField::new(48, 16);
        for (cell, factor) in field.set().iter_mut().zip([1.0, 2.0, 4.0]) {
            *cell = Cell { factor, summand: 0.5 * factor, counts: 1.0 };
        }
        field.set()[2].counts = 0.0;
        let at = |x: f32| field.of([1.0, 0.0, -0.5], x, 8.0);
        assert_eq!(at(2.0), Some([1.5, 0.5, 0.0]));
        assert_eq!(at(16.0), Some([2.25, 0.75, 0.0]));
        assert_eq!(at(31.5).map(|rgb| rgb[2]), Some(0.0));
        assert_eq!((at(32.0), at(47.5)), (None, None));
        field.switch_off();
        assert_eq!(field.of([1.0; 3], 40.0, 8.0), Some([1.0; 3]));
    }
}
