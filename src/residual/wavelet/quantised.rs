//! Quantised coefficients, with margins of zeros around each band.

use super::geometry::{Band, Geometry, MAX_LEVELS, PLANES};

/// Zeros on every side of a band: as far as contexts look.
const MARGIN: usize = 3;

/// Where a band lies.
#[derive(Clone, Copy, Debug, Default)]
pub struct Places {
    first: usize,
    stride: usize,
}

/// The coefficients of a frame.
pub struct Quantised {
    values: Vec<i16>,
    places: [[[Places; 4]; MAX_LEVELS + 1]; PLANES],
}

impl Quantised {
    /// All zero.
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
        Quantised { values: vec![0; len], places }
    }

    /// All zero again.
    pub fn clear(&mut self) {
        self.values.fill(0);
    }

    /// Where a band lies.
    pub fn places(&self, plane: usize, level: usize, orientation: usize) -> Places {
        self.places[plane][level][orientation]
    }

    fn index(places: Places, x: usize, y: usize) -> usize {
        places.first + y * places.stride + x
    }

    /// The value at an offset of at most the margin; zero beyond the band, or if not coded yet.
    pub fn at(&self, places: Places, x: usize, y: usize, dx: isize, dy: isize) -> i16 {
        let index = Self::index(places, x, y) as isize + dy * places.stride as isize + dx;
        self.values[index as usize]
    }

    /// Sum of the magnitudes of the eight neighbours.
    pub fn around(&self, places: Places, x: usize, y: usize) -> i32 {
        let index = Self::index(places, x, y);
        let three = |at: usize| self.values[at - 1..at + 2].iter().map(|v| i32::from(*v).abs());
        let (above, below) = (index - places.stride, index + places.stride);
        let sum: i32 = three(above).chain(three(index)).chain(three(below)).sum();
        sum - i32::from(self.values[index]).abs()
    }

    /// Sets a value of a band.
    pub fn set(&mut self, places: Places, x: usize, y: usize, value: i16) {
        self.values[Self::index(places, x, y)] = value;
    }

    /// A row of a band.
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
