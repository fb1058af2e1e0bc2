//! What a bit is worth at each coefficient, if errors do not count alike.

use std::sync::Arc;

use super::super::interest::Interest;
use super::geometry::{Band, Geometry};
use super::weights::Weights;
use crate::Picture;
use crate::coder_tables::PLANES;
use crate::residual::Tune;

/// Prices by the place of a coefficient in the transformed plane.
pub struct Prices {
    /// What a bit costs by its place: 1 if the weight is the greatest, twice that if it is half of it.
    factors: Vec<f32>,
    of: Option<Arc<Interest>>,
    weights: Weights,
    /// What it costs by the frame, by plane. Empty if all errors count alike.
    by_frame: [Vec<f32>; PLANES],
}

impl Prices {
    /// The same everywhere.
    pub fn new(geometry: &Geometry, tune: Tune) -> Prices {
        let weights = Weights::new(geometry, tune);
        let len = if weights.are_even() { 0 } else { geometry.len() };
        let by_frame = std::array::from_fn(|_| vec![1.0; len]);
        Prices { factors: vec![1.0; geometry.len()], of: None, weights, by_frame }
    }

    /// Sets those of a frame.
    pub fn set_frame(&mut self, geometry: &Geometry, frame: &Picture, render: &Picture) {
        if self.weights.are_even() {
            return;
        }
        self.weights.set(frame, render);
        for band in geometry.bands() {
            for (y, row) in band.rows(geometry).enumerate() {
                for (x, place) in row.enumerate() {
                    let prices = self.weights.prices(&band, x, y);
                    for (plane, price) in self.by_frame.iter_mut().zip(prices) {
                        plane[place] = price;
                    }
                }
            }
        }
    }

    /// Sets those of a region of interest, if it is another object than before.
    pub fn set_interest(&mut self, geometry: &Geometry, interest: Option<&Arc<Interest>>) {
        if self.of.as_ref().map(Arc::as_ptr) == interest.map(Arc::as_ptr) {
            return;
        }
        self.of = interest.cloned();
        self.factors.fill(1.0);
        let Some(interest) = interest else { return };
        let greatest = f32::from(interest.greatest());
        for band in geometry.bands() {
            for (y, row) in band.rows(geometry).enumerate() {
                for (x, factor) in self.factors[row].iter_mut().enumerate() {
                    *factor = greatest / f32::from(weight(interest, geometry, &band, x, y));
                }
            }
        }
    }

    /// The factor of a coefficient.
    pub fn factor(&self, plane: usize, place: usize) -> f32 {
        self.factors[place] * self.by_frame[plane].get(place).unwrap_or(&1.0)
    }
}

/// The greatest weight of the pixels that a coefficient changes most: its cell, and a half of one on either side.
fn weight(interest: &Interest, geometry: &Geometry, band: &Band, x: usize, y: usize) -> u8 {
    let cell = 1 << band.level;
    let around = |at: usize, of: usize| {
        let from = (at * cell).saturating_sub(cell / 2).min(of - 1);
        [from, (at * cell + cell + cell / 2).min(of)]
    };
    let size = (geometry.width, geometry.height);
    interest.within(around(x, size.0), around(y, size.1), size)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_cheap_where_the_weight_is_great() {
        let geometry = Geometry::new(64, 48);
        let mut prices = Prices::new(&geometry, Tune::Psnr);
        assert_eq!(prices.factor(0, 5), 1.0);
        let interest = Interest::rectangle((64, 48), 0..16, 0..16, 8).unwrap();
        prices.set_interest(&geometry, Some(&Arc::new(interest)));
        for band in geometry.bands() {
            for (y, row) in band.rows(&geometry).enumerate() {
                for (x, place) in row.enumerate() {
                    let near = |at: usize| (at << band.level) < 16 + (1 << band.level >> 1);
                    let wanted = if near(x) && near(y) { 1.0 } else { 8.0 };
                    assert_eq!(prices.factor(0, place), wanted, "{band:?} {x} {y}");
                }
            }
        }
        prices.set_interest(&geometry, None);
        assert_eq!(prices.factor(0, 5), 1.0);
    }
}
