//! Quantised coefficients, with margins of zeros around each band.

use super::geometry::{Band, Geometry, MAX_LEVELS, Orientation};
use crate::coder_tables::PLANES;

/// Zeros on every side of a band: as far as contexts look.
const MARGIN: usize = 3;

#[derive(Clone, Copy, Debug, Default)]
pub struct Places {
    first: usize,
    stride: usize,
}

/// What was coded near a place: to the left, above, above to the left and to the right, two to the left, two above; and
/// the sum of the magnitudes further away.
pub struct Near {
    pub next: [i16; 6],
    pub beyond: i32,
}

/// Whether some of them is not zero.
pub fn is_any(values: &[i16]) -> bool {
    values.iter().fold(0, |any, value| any | value) != 0
}

/// The coefficients of a frame.
pub struct Quantised {
    values: Vec<i16>,
    /// Whether a coefficient that the context of a place looks at is not zero. Kept up with every value, as most see
    /// zeros alone.
    loud: Vec<bool>,
    places: [[[Places; 4]; MAX_LEVELS + 1]; PLANES],
}

impl Quantised {
    pub fn new(geometry: &Geometry) -> Quantised {
        let mut places = [[[Places::default(); 4]; MAX_LEVELS + 1]; PLANES];
        let mut len = 0;
        for places in &mut places {
            for band in geometry.bands() {
                // One more of each, as bands of a level differ by one.
                let stride = band.width + 2 * MARGIN + 1;
                let first = len + MARGIN * stride + MARGIN;
                places[band.level][band.orientation.index()] = Places { first, stride };
                len += (band.height + 2 * MARGIN + 1) * stride;
            }
        }
        Quantised { values: vec![0; len], loud: vec![false; len], places }
    }

    pub fn clear(&mut self) {
        self.values.fill(0);
        self.loud.fill(false);
    }

    pub fn places(&self, plane: usize, level: usize, orientation: usize) -> Places {
        self.places[plane][level][orientation]
    }

    fn index(places: Places, x: usize, y: usize) -> usize {
        places.first + y * places.stride + x
    }

    /// The value; zero beyond the band, or if not coded yet.
    pub fn at(&self, places: Places, x: usize, y: usize) -> i16 {
        self.values[Self::index(places, x, y)]
    }

    /// What was coded near a place, in the same band.
    pub fn near(&self, places: Places, x: usize, y: usize) -> Near {
        let Places { stride, .. } = places;
        let index = Self::index(places, x, y);
        let left = &self.values[index - 3..index];
        let above = &self.values[index - stride - 2..][..5];
        let next_above = &self.values[index - 2 * stride - 2..][..5];
        let far_above = self.values[index - 3 * stride];
        let beyond = [above[0], above[4], next_above[0], next_above[1], next_above[3]];
        let beyond = beyond.into_iter().chain([next_above[4], left[0], far_above]);
        Near {
            next: [left[2], above[2], above[1], above[3], left[1], next_above[2]],
            beyond: beyond.map(|value| i32::from(value).abs()).sum(),
        }
    }

    /// Sum of the magnitudes of the eight neighbours.
    pub fn around(&self, places: Places, x: usize, y: usize) -> i32 {
        let index = Self::index(places, x, y);
        let three = |at: usize| self.values[at - 1..at + 2].iter().map(|v| i32::from(*v).abs());
        let (above, below) = (index - places.stride, index + places.stride);
        let sum: i32 = three(above).chain(three(index)).chain(three(below)).sum();
        sum - i32::from(self.values[index]).abs()
    }

    /// Whether a context sees zeros alone: near, above, beside, and in other planes.
    pub fn is_quiet(&self, places: Places, x: usize, y: usize) -> bool {
        !self.loud[Self::index(places, x, y)]
    }

    /// Sets a value of a band of a plane; it is not zero.
    pub fn set(&mut self, plane: usize, band: &Band, x: usize, y: usize, value: i16) {
        let own = self.places[plane][band.level][band.orientation.index()];
        self.values[Self::index(own, x, y)] = value;
        self.mark_near(own, x, y);
        self.mark_relatives(plane, band, x, y);
    }

    /// Contexts of the same band that look at a coefficient.
    fn mark_near(&mut self, own: Places, x: usize, y: usize) {
        let index = Self::index(own, x, y);
        self.loud[index + 1..index + 4].fill(true);
        for row in [1, 2] {
            let below = index + row * own.stride;
            self.loud[below - 2..below + 3].fill(true);
        }
        self.loud[index + 3 * own.stride] = true;
    }

    /// Contexts of other bands that look at a coefficient.
    fn mark_relatives(&mut self, plane: usize, band: &Band, x: usize, y: usize) {
        let (level, orientation) = (band.level, band.orientation.index());
        for other in plane + 1..PLANES {
            self.mark(self.places[other][level][orientation], (x, y), 1, 3);
        }
        if band.orientation == Orientation::Low {
            return;
        }
        for sibling in orientation + 1..4 {
            self.mark(self.places[plane][level][sibling], (x, y), 1, 3);
        }
        if level > 1 {
            let children = self.places[plane][level - 1][orientation];
            self.mark(children, (2 * x, 2 * y), 2, 6);
        }
        if level > 2 {
            let grandchildren = self.places[plane][level - 2][orientation];
            self.mark(grandchildren, (4 * x, 4 * y), 0, 4);
        }
    }

    /// Marks a square that begins `before` to the left of a place and above it; it may reach into the margin.
    fn mark(&mut self, places: Places, (x, y): (usize, usize), before: usize, side: usize) {
        let first = Self::index(places, x, y) - before * (places.stride + 1);
        for row in 0..side {
            let start = first + row * places.stride;
            self.loud[start..start + side].fill(true);
        }
    }

    pub fn row(&self, plane: usize, band: &Band, y: usize) -> &[i16] {
        let places = self.places[plane][band.level][band.orientation.index()];
        let start = Self::index(places, 0, y);
        &self.values[start..start + band.width]
    }

    /// Copies a plane's values to their places in a transformed plane.
    pub fn copy_to(&self, geometry: &Geometry, plane: usize, into: &mut [i16]) {
        for band in geometry.bands() {
            for (y, place) in band.rows(geometry).enumerate() {
                into[place].copy_from_slice(self.row(plane, &band, y));
            }
        }
    }
}
