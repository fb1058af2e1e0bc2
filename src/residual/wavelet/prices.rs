//! What a bit is worth at each coefficient, if parts of the picture count more than others.

use std::sync::Arc;

use super::super::interest::Interest;
use super::geometry::{Band, Geometry};

/// Prices by the place of a coefficient in the transformed plane. Their memory is taken with the first.
pub struct Prices {
    /// What a bit costs: 1 if the weight is the greatest, twice that if it is half of it.
    factors: Vec<f32>,
    of: Option<Arc<Interest>>,
}

impl Prices {
    /// The same everywhere.
    pub fn new(geometry: &Geometry) -> Prices {
        Prices { factors: vec![1.0; geometry.len()], of: None }
    }

    /// Sets them for a region of interest, if it is another object than before.
    pub fn set(&mut self, geometry: &Geometry, interest: Option<&Arc<Interest>>) {
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
    pub fn factor(&self, place: usize) -> f32 {
        self.factors[place]
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
        let mut prices = Prices::new(&geometry);
        assert_eq!(prices.factor(5), 1.0);
        let interest = Interest::rectangle((64, 48), 0..16, 0..16, 8).unwrap();
        prices.set(&geometry, Some(&Arc::new(interest)));
        for band in geometry.bands() {
            for (y, row) in band.rows(&geometry).enumerate() {
                for (x, place) in row.enumerate() {
                    let near = |at: usize| (at << band.level) < 16 + (1 << band.level >> 1);
                    let wanted = if near(x) && near(y) { 1.0 } else { 8.0 };
                    assert_eq!(prices.factor(place), wanted, "{band:?} {x} {y}");
                }
            }
        }
        prices.set(&geometry, None);
        assert_eq!(prices.factor(5), 1.0);
    }
}
