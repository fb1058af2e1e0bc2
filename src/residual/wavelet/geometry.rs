//! Sizes of a picture's wavelet bands, and the weight of a coefficient in each.

use std::ops::Range;

use crate::coder_tables::PLANES;

use super::lifting;

/// Most levels of the transform.
pub const MAX_LEVELS: usize = 6;
/// Values by plane, rows of the picture's width.
pub type Planes = [Vec<i32>; PLANES];
/// Finest level that is coded, by plane; one more than the levels: none at all.
pub type Finest = [usize; PLANES];
/// A picture whose longer side is this or less is not divided further, pixels.
const SMALLEST: usize = 5;

/// Which half of the spectrum a band holds, along x and y.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Orientation {
    /// Low along both: the picture itself, smaller.
    Low = 0,
    /// High along x.
    Horizontal = 1,
    /// High along y.
    Vertical = 2,
    /// High along both.
    Diagonal = 3,
}

impl Orientation {
    /// Those of every level.
    pub const DETAILS: [Orientation; 3] =
        [Orientation::Horizontal, Orientation::Vertical, Orientation::Diagonal];

    /// Number, 0 to 3.
    pub fn index(self) -> usize {
        self as usize
    }

    fn is_high(self) -> (bool, bool) {
        (self as u8 & 1 > 0, self as u8 & 2 > 0)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Band {
    /// 1 for the finest; the number of levels for the coarsest, and for [`Orientation::Low`].
    pub level: usize,
    /// Its half of the spectrum.
    pub orientation: Orientation,
    /// Coefficients in a row.
    pub width: usize,
    pub height: usize,
    /// Place of the first coefficient in the transformed plane.
    pub offset: usize,
}

impl Band {
    /// Number of its level for the tables: 0 for the low band, else the level.
    pub fn rank(&self) -> usize {
        if self.orientation == Orientation::Low { 0 } else { self.level }
    }

    /// Places of its rows in the transformed plane.
    pub fn rows(&self, geometry: &Geometry) -> impl Iterator<Item = Range<usize>> + use<> {
        let Band { width, height, offset, .. } = *self;
        let stride = geometry.width;
        (0..height).map(move |y| offset + y * stride..offset + y * stride + width)
    }
}

/// The bands of pictures of one size.
///
/// A transformed plane has the picture's size. The low band of each level lies in the upper left corner of
/// the level before.
#[derive(Clone, Debug)]
pub struct Geometry {
    /// Width, pixels: the stride of a plane.
    pub width: usize,
    /// Height, pixels.
    pub height: usize,
    /// Levels of the transform, up to [`MAX_LEVELS`]; 0 for the smallest pictures.
    pub levels: usize,
    /// Width and height of the low band by level; level 0 is the picture.
    pub sizes: [(usize, usize); MAX_LEVELS + 1],
    /// Norm of the picture that a coefficient of 1 makes, by level and orientation.
    norms: [[f64; 4]; MAX_LEVELS + 1],
}

impl Geometry {
    /// For pictures of a size.
    pub fn new(width: u32, height: u32) -> Geometry {
        let (width, height) = (width as usize, height as usize);
        let mut sizes = [(width, height); MAX_LEVELS + 1];
        let mut levels = 0;
        while levels < MAX_LEVELS && sizes[levels].0.max(sizes[levels].1) > SMALLEST {
            let (w, h) = sizes[levels];
            levels += 1;
            sizes[levels..].fill((w.div_ceil(2), h.div_ceil(2)));
        }
        Geometry { width, height, levels, sizes, norms: norms() }
    }

    pub fn len(&self) -> usize {
        self.width * self.height
    }

    /// A band of a level, 1 and up; [`Orientation::Low`] is the low band of the last level.
    pub fn band(&self, level: usize, orientation: Orientation) -> Band {
        let (w, h) = self.sizes[level];
        let (all_w, all_h) = self.sizes[level.saturating_sub(1)];
        let (right, below) = orientation.is_high();
        Band {
            level,
            orientation,
            width: if right { all_w - w } else { w },
            height: if below { all_h - h } else { h },
            offset: if right { w } else { 0 } + if below { h * self.width } else { 0 },
        }
    }

    /// All bands in coding order: from coarse to fine.
    pub fn bands(&self) -> impl Iterator<Item = Band> + '_ {
        let low = std::iter::once(self.band(self.levels, Orientation::Low));
        let details = (1..=self.levels).rev().flat_map(|level| {
            Orientation::DETAILS.map(|orientation| self.band(level, orientation))
        });
        low.chain(details)
    }

    /// The block that a coefficient lies in: the value of the coarsest low band above it.
    pub fn block(&self, band: &Band, x: usize, y: usize) -> usize {
        let shift = self.levels - band.level;
        let (width, height) = self.sizes[self.levels];
        (y >> shift).min(height - 1) * width + (x >> shift).min(width - 1)
    }

    /// Norm of the picture that a coefficient of 1 in a band makes.
    pub fn norm(&self, band: &Band) -> f64 {
        self.norms[band.level][band.orientation.index()]
    }
}

/// Norms by level and orientation: products of those along a line.
fn norms() -> [[f64; 4]; MAX_LEVELS + 1] {
    let mut norms = [[1.0; 4]; MAX_LEVELS + 1];
    for (level, norms) in norms.iter_mut().enumerate().skip(1) {
        let (low, high) = lifting::line_norms(level);
        *norms = [low * low, high * low, low * high, high * high];
    }
    norms
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_cover_a_plane_once() {
        for (width, height) in [(1, 1), (1, 40), (5, 3), (7, 6), (320, 180), (641, 363)] {
            let geometry = Geometry::new(width, height);
            let mut seen = vec![0; geometry.len()];
            for band in geometry.bands() {
                for y in 0..band.height {
                    for x in 0..band.width {
                        seen[band.offset + y * geometry.width + x] += 1;
                    }
                }
            }
            assert!(seen.iter().all(|n| *n == 1), "{width}×{height}");
        }
    }

    #[test]
    fn the_usual_frame_has_six_levels() {
        let geometry = Geometry::new(320, 180);
        assert_eq!((geometry.levels, geometry.sizes[6]), (6, (5, 3)));
        assert_eq!(Geometry::new(5, 5).levels, 0);
    }
}
