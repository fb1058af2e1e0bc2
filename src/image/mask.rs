//! Which pixels of a picture count.

use super::view::{GRAY, check_size};
use super::{ImageView, Picture, PixelError};
use crate::Camera;
use crate::geometry::{Lens, LensError};

/// A truth value for each pixel of a picture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mask {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// `width · height` values, row-major: which pixels count.
    pub data: Vec<bool>,
}

impl Mask {
    /// Value of a mask's picture from which a pixel counts.
    pub const WHITE: u8 = 128;

    /// The mask of this size by which all pixels count.
    pub fn all(width: u32, height: u32) -> Mask {
        Mask { width, height, data: vec![true; width as usize * height as usize] }
    }

    /// The mask of this size by which no pixel counts.
    pub fn none(width: u32, height: u32) -> Mask {
        Mask { width, height, data: vec![false; width as usize * height as usize] }
    }

    /// Reads a picture of one byte per pixel: white counts (128 and more), black does not. `stride`: bytes from one row
    /// to the next. The last row may end before its stride does.
    ///
    /// # Errors
    /// If a side is zero or above [`ImageView::MAX_SIDE`], the stride is shorter than a row, or bytes are missing.
    pub fn from_gray(
        width: u32,
        height: u32,
        bytes: &[u8],
        stride: usize,
    ) -> Result<Mask, PixelError> {
        check_size(width, height, ImageView::MAX_SIDE)?;
        GRAY.check((width, height), stride, bytes.len())?;
        let rows = bytes.chunks(stride).take(height as usize);
        let data = rows.flat_map(|row| row[..width as usize].iter().map(|v| *v >= Self::WHITE));
        Ok(Mask { width, height, data: data.collect() })
    }

    /// How many pixels count.
    pub fn count(&self) -> usize {
        self.data.iter().filter(|counts| **counts).count()
    }

    /// The share of pixels that count, in [0, 1].
    pub fn share(&self) -> f64 {
        self.count() as f64 / self.data.len().max(1) as f64
    }

    /// Leaves only those pixels that count in the other mask, too.
    ///
    /// # Panics
    /// If the sizes differ.
    pub fn intersect(&mut self, other: &Mask) {
        assert_eq!((self.width, self.height), (other.width, other.height), "mask sizes differ");
        self.data.iter_mut().zip(&other.data).for_each(|(own, other)| *own &= *other);
    }

    /// The mask whose pixels are `factor × factor` blocks of this one's. Blocks that do not fit whole are left out, as
    /// in [`Camera::reduced`]. A block counts if all of it does.
    pub fn reduced(&self, factor: u32) -> Mask {
        let (width, height) = (self.width / factor, self.height / factor);
        let mut reduced = Mask::all(width, height);
        let side = factor as usize;
        let (columns, inside) = (width as usize, (width * factor) as usize);
        let rows = self.data.chunks_exact(self.width.max(1) as usize);
        for (y, row) in rows.take((height * factor) as usize).enumerate() {
            for (x, counts) in row[..inside].iter().enumerate() {
                reduced.data[y / side * columns + x / side] &= *counts;
            }
        }
        reduced
    }

    /// The mask at another size: a pixel counts if all that it shows counts.
    pub fn resized(&self, width: u32, height: u32) -> Mask {
        if (width, height) == (self.width, self.height) {
            return self.clone();
        }
        let window = |at: u32, side: u32, to: u32| {
            let (at, side, to) = (u64::from(at), u64::from(side), u64::from(to));
            (at * side / to) as usize..((at + 1) * side).div_ceil(to) as usize
        };
        let mut data = Vec::with_capacity(width as usize * height as usize);
        for y in 0..height {
            let rows = window(y, self.height, height);
            for x in 0..width {
                let columns = window(x, self.width, width);
                let row = |y: usize| &self.data[y * self.width as usize..][columns.clone()];
                data.push(rows.clone().all(|y| row(y).iter().all(|counts| *counts)));
            }
        }
        Mask { width, height, data }
    }

    /// The mask of a lens's undistorted pictures: a pixel counts if all that it shows lies on the lens's picture and
    /// counts there.
    ///
    /// # Errors
    /// If the mask has not the size of the lens's pictures, or `to` cannot be rendered.
    pub fn undistorted(&self, lens: &Lens, to: &Camera) -> Result<Mask, LensError> {
        to.check()?;
        let (found, expected) = ((self.width, self.height), lens.size());
        if found != expected || self.data.len() as u64 != u64::from(found.0) * u64::from(found.1) {
            return Err(LensError::Size { found, expected });
        }
        let mut mask = Mask::none(to.width, to.height);
        lens.each_footprint(to, |index, footprint| {
            let mut counts = footprint.whole && self.data[footprint.nearest(expected)];
            if counts {
                let visit = |index: usize, _| counts &= self.data[index];
                footprint.visit(footprint.sides, 0.5, expected, visit);
            }
            mask.data[index] = counts;
        });
        Ok(mask)
    }

    /// The mean colour of the pixels that count; black if none does.
    fn mean(&self, picture: &Picture) -> [u8; 3] {
        let (mut sums, mut count) = ([0u64; 3], 0);
        for (rgb, _) in picture.data.chunks_exact(3).zip(&self.data).filter(|(_, counts)| **counts)
        {
            sums.iter_mut().zip(rgb).for_each(|(sum, value)| *sum += u64::from(*value));
            count += 1;
        }
        let count = count.max(1);
        sums.map(|sum| ((sum + count / 2) / count) as u8)
    }

    /// Gives the pixels that do not count the mean colour of the others.
    pub(crate) fn level_out(&self, picture: &mut Picture) {
        let mean = self.mean(picture);
        self.each_masked(&mut picture.data, |_, rgb| rgb.copy_from_slice(&mean));
    }

    /// Calls `change` with each pixel of `rgb` that does not count, and the index of its first byte.
    pub(crate) fn each_masked(&self, rgb: &mut [u8], mut change: impl FnMut(usize, &mut [u8])) {
        let pixels = rgb.chunks_exact_mut(3).zip(&self.data).enumerate();
        for (index, (rgb, _)) in pixels.filter(|(_, (_, counts))| !**counts) {
            change(3 * index, rgb);
        }
    }

    /// [`Picture::mse`] over the pixels that count; 0 if none does.
    ///
    /// # Panics
    /// If the sizes differ.
    pub fn mse(&self, a: &Picture, b: &Picture) -> f64 {
        assert_eq!((a.width, a.height), (self.width, self.height), "picture and mask sizes differ");
        assert_eq!((a.width, a.height), (b.width, b.height), "picture sizes differ");
        let pixels = a.data.chunks_exact(3).zip(b.data.chunks_exact(3)).zip(&self.data);
        let (mut sum, mut count) = (0u64, 0u64);
        for ((a, b), _) in pixels.filter(|(_, counts)| **counts) {
            sum += a.iter().zip(b).map(|(a, b)| u64::from(a.abs_diff(*b)).pow(2)).sum::<u64>();
            count += 3;
        }
        sum as f64 / count.max(1) as f64 / (255.0 * 255.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gray_picture_says_what_counts() {
        let bytes = [0, 127, 128, 9, 255, 200, 0];
        let mask = Mask::from_gray(3, 2, &bytes, 4).unwrap();
        assert_eq!(mask.data, [false, false, true, true, true, false]);
        assert_eq!((mask.count(), mask.share()), (3, 0.5));
        assert!(matches!(Mask::from_gray(3, 2, &bytes[..6], 4), Err(PixelError::TooShort { .. })));
        assert!(matches!(Mask::from_gray(3, 2, &bytes, 2), Err(PixelError::Stride { .. })));
        assert!(matches!(Mask::from_gray(0, 2, &bytes, 4), Err(PixelError::Size { .. })));
    }

    #[test]
    fn a_resized_pixel_counts_if_all_of_it_does() {
        let mut mask = Mask::all(4, 2);
        mask.data[6] = false;
        assert_eq!(mask.resized(2, 1).data, [true, false]);
        assert_eq!(mask.resized(4, 2), mask);
        assert_eq!(mask.resized(8, 4).data.iter().filter(|counts| !**counts).count(), 4);
        // Windows of 4/3 of a pixel: the second and the third touch the masked one.
        assert_eq!(mask.resized(3, 1).data, [true, false, false]);
    }

    #[test]
    fn a_block_counts_if_all_of_it_does() {
        let mut mask = Mask::all(5, 5);
        (mask.data[3], mask.data[24]) = (false, false);
        let reduced = mask.reduced(2);
        assert_eq!((reduced.width, reduced.height), (2, 2));
        assert_eq!(reduced.data, [true, false, true, true], "the last column is left out");
        assert_eq!(mask.reduced(1), mask);
        assert_eq!(mask.reduced(6), Mask::all(0, 0));
    }

    #[test]
    fn what_is_masked_is_levelled_out() {
        let mut picture = Picture::from_rgb(2, 2, (0..12).collect()).unwrap();
        let mut mask = Mask::all(2, 2);
        mask.data[2] = false;
        mask.level_out(&mut picture);
        assert_eq!(picture.data, [0, 1, 2, 3, 4, 5, 4, 5, 6, 9, 10, 11]);
    }

    #[test]
    fn an_undistorted_pixel_counts_if_all_of_it_does() {
        use crate::geometry::{Distortion, Intrinsics};
        let intrinsics =
            Intrinsics { width: 480, height: 270, fx: 330.0, fy: 332.0, cx: 236.0, cy: 141.0 };
        let lens = Lens::new(intrinsics, Distortion::None).unwrap();
        let mut mask = Mask::all(480, 270);
        mask.data[100] = false;
        let same = mask.undistorted(&lens, &lens.pinhole()).unwrap();
        assert_eq!(same, mask);
        let small = mask.undistorted(&lens, &lens.pinhole().resized(48, 27)).unwrap();
        assert_eq!(small.data.iter().position(|counts| !counts), Some(10));
        assert_eq!(small.count(), 48 * 27 - 1);
    }

    #[test]
    fn the_error_is_that_of_what_counts() {
        let mut mask = Mask::all(2, 1);
        let (a, mut b) = (Picture::new(2, 1), Picture::new(2, 1));
        b.data.copy_from_slice(&[0, 255, 0, 255, 255, 255]);
        assert_eq!(mask.mse(&a, &b), a.mse(&b));
        mask.data[1] = false;
        assert!((mask.mse(&a, &b) - 1.0 / 3.0).abs() < 1e-12);
        assert_eq!(Mask::none(2, 1).mse(&a, &b), 0.0);
    }
}
