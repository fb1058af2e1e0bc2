//! 8-bit RGB pictures and the figures that compare them.

/// An 8-bit RGB picture, row-major without padding.
#[derive(PartialEq, Eq, Default)]
pub struct Picture {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// `width · height · 3` bytes.
    pub data: Vec<u8>,
}

impl std::fmt::Debug for Picture {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Picture({}×{})", self.width, self.height)
    }
}

impl Clone for Picture {
    fn clone(&self) -> Picture {
        Picture { width: self.width, height: self.height, data: self.data.clone() }
    }

    /// Allocates only beyond the largest size that `self` had.
    fn clone_from(&mut self, other: &Picture) {
        (self.width, self.height) = (other.width, other.height);
        self.data.clone_from(&other.data);
    }
}

impl Picture {
    /// A black picture.
    pub fn new(width: u32, height: u32) -> Picture {
        Picture { width, height, data: vec![0; width as usize * height as usize * 3] }
    }

    /// Takes row-major RGB bytes; `None` if their number does not fit the size.
    pub fn from_rgb(width: u32, height: u32, data: Vec<u8>) -> Option<Picture> {
        (data.len() == width as usize * height as usize * 3).then_some(Picture {
            width,
            height,
            data,
        })
    }

    /// Gives it another size; its pixels are then meaningless. Allocates only beyond its largest size so far.
    pub fn resize(&mut self, width: u32, height: u32) {
        (self.width, self.height) = (width, height);
        self.data.resize(width as usize * height as usize * 3, 0);
    }

    /// Mean over pixels and channels of the squared difference, values in [0, 1].
    ///
    /// # Panics
    /// If the sizes differ.
    pub fn mse(&self, other: &Picture) -> f64 {
        assert_eq!((self.width, self.height), (other.width, other.height), "picture sizes differ");
        let squares = |(a, b): (&[u8], &[u8])| -> u32 {
            std::iter::zip(a, b).map(|(a, b)| u32::from(a.abs_diff(*b)).pow(2)).sum()
        };
        // The sum over so many values stays below 2³².
        let parts = self.data.chunks(1 << 16).zip(other.data.chunks(1 << 16));
        let sum: u64 = parts.map(|part| u64::from(squares(part))).sum();
        sum as f64 / self.data.len().max(1) as f64 / (255.0 * 255.0)
    }

    /// Peak signal-to-noise ratio in dB against peak 255 (the paper's eq. psnr); infinite for equal
    /// pictures.
    ///
    /// # Panics
    /// If the sizes differ.
    pub fn psnr(&self, other: &Picture) -> f64 {
        psnr_of_mse(self.mse(other))
    }
}

/// PSNR in dB of a mean squared error of values in [0, 1].
pub fn psnr_of_mse(mse: f64) -> f64 {
    -10.0 * mse.log10()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn psnr_of_one_step_everywhere() {
        let a = Picture::from_rgb(2, 1, vec![10; 6]).unwrap();
        let b = Picture::from_rgb(2, 1, vec![11; 6]).unwrap();
        assert!((a.psnr(&b) - 48.1308).abs() < 1e-3);
        assert_eq!(a.psnr(&a), f64::INFINITY);
        assert!(Picture::from_rgb(2, 2, vec![0; 6]).is_none());
    }
}
