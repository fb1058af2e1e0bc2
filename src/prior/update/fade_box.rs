//! Boxes of fades, in the prior's unit.

use super::fade::Fade;
use super::grid::UpdateGrid;

/// A fade with its box in the prior's unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FadeBox {
    /// The prior's unit; belongs to the box.
    from: [f64; 3],
    /// Does not belong to it.
    to: [f64; 3],
    factor: u8,
}

impl FadeBox {
    pub fn new(fade: &Fade, grid: &UpdateGrid) -> FadeBox {
        let [from, to] = grid.corners(fade);
        FadeBox { from, to, factor: fade.factor }
    }

    /// What opacities at a position are multiplied by.
    pub fn at(&self, position: [f32; 3]) -> f32 {
        let within = |axis: usize| {
            let place = f64::from(position[axis]);
            self.from[axis] <= place && place < self.to[axis]
        };
        if (0..3).all(within) { f32::from(self.factor) / 255.0 } else { 1.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_ends_where_the_next_begins() {
        let grid = UpdateGrid { origin: [1.0, 0.0, 0.0], exponent: -3 };
        let fade = grid.fade([1.5, 0.5, 0.5], [2.5, 0.5, 0.5], 51);
        assert_eq!(fade, Fade { min: [0; 3], max: [1, 0, 0], factor: 51 });
        let (left, right) = (
            FadeBox::new(&fade, &grid),
            FadeBox::new(&Fade { min: [2, 0, 0], max: [2, 0, 0], factor: 0 }, &grid),
        );
        let at = |x: f32| (left.at([x, 0.0, 0.999]), right.at([x, 0.0, 0.999]));
        assert_eq!(at(0.999), (1.0, 1.0));
        assert_eq!(at(1.0), (0.2, 1.0));
        assert_eq!(at(2.999), (0.2, 1.0));
        assert_eq!(at(3.0), (1.0, 0.0));
        assert_eq!(left.at([1.5, 1.0, 0.0]), 1.0);
        assert_eq!(left.at([f32::NAN; 3]), 1.0);
    }
}
