//! The grid of an update's positions.

use super::fade::Fade;
use super::limits::{CELL_STEPS, EXPONENTS};

/// Where positions are counted from, and in which steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UpdateGrid {
    /// A place in the prior's unit, finite. Near the splats, updates are smallest.
    pub origin: [f32; 3],
    /// The step is two to the power of this, in the prior's unit: [`EXPONENTS`].
    pub exponent: i8,
}

impl UpdateGrid {
    /// The step, in the prior's unit.
    pub fn step(&self) -> f64 {
        // Exact, as a power of two is.
        let exponent = i32::from(self.exponent);
        f64::from_bits(((1023 + exponent) as u64) << 52)
    }

    /// The position of whole steps, rounded to f32 once. It is finite if the grid is valid.
    pub fn position(&self, steps: [i32; 3]) -> [f32; 3] {
        std::array::from_fn(|axis| {
            (f64::from(self.origin[axis]) + f64::from(steps[axis]) * self.step()) as f32
        })
    }

    /// The nearest steps of a position; the outermost ones for positions beyond, 0 for NaN.
    pub fn steps(&self, position: [f32; 3]) -> [i32; 3] {
        self.offset(position, self.step(), f64::round)
    }

    /// The cell of [`CELL_STEPS`] steps that a position lies in.
    pub fn cell(&self, position: [f32; 3]) -> [i32; 3] {
        self.offset(position, self.cell_size(), f64::floor)
    }

    /// Fades what lies between two corners, in whole cells, to `factor` parts of 255.
    pub fn fade(&self, min: [f32; 3], max: [f32; 3], factor: u8) -> Fade {
        Fade { min: self.cell(min), max: self.cell(max), factor }
    }

    /// The corners of a fade in the scene. The first belongs to it, the second does not.
    pub fn corners(&self, fade: &Fade) -> [[f64; 3]; 2] {
        let beyond = fade.max.map(|cell| i64::from(cell) + 1);
        [self.corner(fade.min.map(i64::from)), self.corner(beyond)]
    }

    /// The lower corner of a cell.
    fn corner(&self, cell: [i64; 3]) -> [f64; 3] {
        // A cell's number and eight times it are exact in f64.
        let size = self.cell_size();
        std::array::from_fn(|axis| f64::from(self.origin[axis]) + cell[axis] as f64 * size)
    }

    fn cell_size(&self) -> f64 {
        f64::from(CELL_STEPS) * self.step()
    }

    fn offset(&self, position: [f32; 3], step: f64, whole: fn(f64) -> f64) -> [i32; 3] {
        std::array::from_fn(|axis| {
            let offset = f64::from(position[axis]) - f64::from(self.origin[axis]);
            whole(offset / step) as i32
        })
    }

    /// What is wrong with it.
    pub(super) fn fault(&self) -> Option<String> {
        if let Some(axis) = self.origin.iter().position(|value| !value.is_finite()) {
            return Some(format!("origin {} is not finite on axis {axis}", self.origin[axis]));
        }
        let (exponent, least, most) = (self.exponent, EXPONENTS.start(), EXPONENTS.end());
        let known = EXPONENTS.contains(&exponent);
        (!known).then(|| format!("positions in steps of 2^{exponent}: 2^{least} to 2^{most}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_and_positions_are_inverse() {
        let grid = UpdateGrid { origin: [10.0, -3.5, 0.0], exponent: -6 };
        assert_eq!(grid.step(), 1.0 / 64.0);
        let steps = [-640, 7, 100_000];
        assert_eq!(grid.position(steps), [0.0, -3.390_625, 1562.5]);
        assert_eq!(grid.steps(grid.position(steps)), steps);
        assert_eq!(grid.steps([10.007, f32::NAN, 1e30]), [0, 0, i32::MAX]);
    }

    #[test]
    fn a_cell_holds_eight_steps_from_its_corner_on() {
        let grid = UpdateGrid { origin: [1.0, 0.0, 0.0], exponent: -3 };
        assert_eq!(grid.cell([1.0, 0.999, -0.001]), [0, 0, -1]);
        assert_eq!(grid.corner([0, 1, -1]), [1.0, 1.0, -1.0]);
    }

    #[test]
    fn every_position_is_finite() {
        for exponent in [-40, 40] {
            let grid = UpdateGrid { origin: [f32::MAX, f32::MIN, 0.0], exponent };
            assert_eq!(grid.fault(), None);
            for steps in [i32::MIN, 0, i32::MAX] {
                assert!(grid.position([steps; 3]).iter().all(|v| v.is_finite()));
            }
        }
    }

    #[test]
    fn bad_grids_say_why() {
        let grid = |origin, exponent| UpdateGrid { origin: [0.0, origin, 0.0], exponent };
        let fault = grid(f32::NAN, 0).fault().unwrap();
        assert_eq!(fault, "origin NaN is not finite on axis 1");
        assert_eq!(grid(0.0, 41).fault().unwrap(), "positions in steps of 2^41: 2^-40 to 2^40");
    }
}
