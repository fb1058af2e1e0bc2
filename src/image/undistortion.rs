//! Pictures of a lens as pictures of a pinhole camera, by a map that is made once.

use glam::DVec2;

use super::{ImageView, Mask};
use crate::geometry::{Footprint, Lens, LensError};
use crate::{Camera, Picture};

/// Fractional bits of places on the reduced picture, and of a sample's weights.
const BITS: u32 = 16;
const WEIGHT_BITS: u32 = 12;
const ONE: i32 = 1 << BITS;

/// A side may be longer than a whole number of pixels by this, without another sample.
const LONGER: i32 = ONE / 32;

/// Samples a lens's picture, reduced by area averaging, where the camera's pixels lie.
pub(super) struct Undistortion {
    size: (u32, u32),
    reduced: Picture,
    /// Places of the camera's pixels, row by row. Those that are not covered have none.
    places: Vec<FixedFootprint>,
    covered: Mask,
}

/// A footprint on the reduced picture, with [`BITS`].
#[derive(Clone, Copy, Default)]
struct FixedFootprint {
    centre: [i32; 2],
    sides: [[i32; 2]; 2],
}

impl Undistortion {
    /// See [`super::Converter::undistorting`].
    pub fn new(lens: &Lens, camera: &Camera) -> Result<Undistortion, LensError> {
        camera.check()?;
        let (width, height) = lens.size();
        let max = ImageView::MAX_SIDE;
        if width > max || height > max {
            return Err(LensError::Side { width, height, max });
        }
        lens.check_corners()?;
        let mut covered = Mask::none(camera.width, camera.height);
        let mut min = f64::INFINITY;
        lens.each_footprint(camera, |pixel, footprint| {
            covered.data[pixel] = footprint.whole;
            if footprint.whole {
                let [across, down] = [footprint.sides.x_axis, footprint.sides.y_axis];
                min = min.min(across.length()).min(down.length());
            }
        });
        if !min.is_finite() {
            return Err(LensError::Nothing);
        }
        // A hundredth less is no loss, as rounding of sizes is as much.
        let factor = ((min + 0.01).floor() as u32).max(1);
        let reduced = Picture::new(width.div_ceil(factor), height.div_ceil(factor));
        let scale = DVec2::new(reduced.width.into(), reduced.height.into())
            / DVec2::new(width.into(), height.into());
        let mut places = vec![FixedFootprint::default(); camera.pixels()];
        lens.each_footprint(camera, |pixel, footprint| {
            if footprint.whole {
                places[pixel] = FixedFootprint::new(&footprint, scale);
            }
        });
        Ok(Undistortion { size: (width, height), reduced, places, covered })
    }

    /// Width and height of the lens's pictures, pixels.
    pub fn size(&self) -> (u32, u32) {
        self.size
    }

    /// Width and height of the lens's pictures as they are sampled, pixels.
    pub fn reduced_size(&self) -> (u32, u32) {
        (self.reduced.width, self.reduced.height)
    }

    /// The lens's picture, for [`Undistortion::apply`].
    pub fn reduced(&mut self) -> &mut Picture {
        &mut self.reduced
    }

    /// Which pixels of the camera show the lens's picture.
    pub fn covered(&self) -> &Mask {
        &self.covered
    }

    /// Makes `into` the camera's picture. What is not covered is black.
    pub fn apply(&self, into: &mut Picture) {
        into.resize(self.covered.width, self.covered.height);
        let pixels = into.data.chunks_exact_mut(3).zip(&self.places).zip(&self.covered.data);
        for ((rgb, place), covered) in pixels {
            rgb.copy_from_slice(&if *covered { place.mean(&self.reduced) } else { [0; 3] });
        }
    }
}

impl FixedFootprint {
    fn new(footprint: &Footprint, scale: DVec2) -> FixedFootprint {
        let fixed = |v: DVec2| (v * scale * f64::from(ONE)).to_array().map(|v| v.round() as i32);
        let Footprint { centre, sides, .. } = *footprint;
        FixedFootprint { centre: fixed(centre), sides: [fixed(sides.x_axis), fixed(sides.y_axis)] }
    }

    /// The mean of samples over the footprint.
    fn mean(&self, picture: &Picture) -> [u8; 3] {
        let [across, down] = self.sides.map(Side::new);
        let first: [i32; 2] =
            std::array::from_fn(|k| self.centre[k] - ONE / 2 + across.first(k) + down.first(k));
        let mut sums = [0u64; 3];
        for j in 0..down.count {
            let mut at: [i32; 2] = std::array::from_fn(|k| first[k] + j * down.step[k]);
            for _ in 0..across.count {
                let sample = sample(picture, at);
                sums.iter_mut().zip(sample).for_each(|(sum, value)| *sum += u64::from(value));
                at = std::array::from_fn(|k| at[k] + across.step[k]);
            }
        }
        let whole = (across.count * down.count) as u64 * (1 << (2 * WEIGHT_BITS));
        sums.map(|sum| ((sum + whole / 2) / whole) as u8)
    }
}

/// How a side of a footprint is sampled.
struct Side {
    count: i32,
    step: [i32; 2],
}

impl Side {
    fn new(side: [i32; 2]) -> Side {
        let longest = side[0].abs().max(side[1].abs());
        let count = ((longest - LONGER + ONE - 1) >> BITS).max(1);
        Side { count, step: side.map(|v| v / count) }
    }

    /// Distance from the footprint's middle to the first sample.
    fn first(&self, k: usize) -> i32 {
        -self.step[k] * (self.count - 1) / 2
    }
}

/// A picture's value between four pixels, by channel, with twice [`WEIGHT_BITS`]. `at`: from the middle of the first
/// pixel, with [`BITS`]. Beyond the edge it is that of the edge.
fn sample(picture: &Picture, at: [i32; 2]) -> [u32; 3] {
    let place = |at: i32, length: u32| {
        let (whole, last) = (at >> BITS, length as i32 - 1);
        let weight = (at >> (BITS - WEIGHT_BITS)) as u32 & ((1 << WEIGHT_BITS) - 1);
        ([whole, whole + 1].map(|v| v.clamp(0, last) as usize), weight)
    };
    let ([left, right], across) = place(at[0], picture.width);
    let ([above, below], down) = place(at[1], picture.height);
    let width = picture.width as usize;
    let [a, b] = [above, below].map(|row| {
        let pixel = |column: usize| &picture.data[3 * (row * width + column)..][..3];
        let (left, right) = (pixel(left), pixel(right));
        std::array::from_fn::<u32, 3, _>(|c| {
            u32::from(left[c]) * ((1 << WEIGHT_BITS) - across) + u32::from(right[c]) * across
        })
    });
    // 255 · 2²⁴ is below 2³².
    std::array::from_fn(|c| a[c] * ((1 << WEIGHT_BITS) - down) + b[c] * down)
}
