//! The scaling filter, along one axis.
//!
//! A target pixel is the mean of the source over a window around its centre; the source is constant
//! over each of its samples. If the picture shrinks, the window is one target pixel wide. That is
//! exact area averaging: what a sensor with larger pixels would see. If the picture grows, the
//! window is one source sample wide. That is exactly linear interpolation.
//!
//! One filter serves both. It reads each source row once, or twice at the border of two pixels. How it compares with
//! others: docs/decisions.md, 1.

/// Fractional bits of weights; the weights of a pixel sum to exactly one.
pub(super) const WEIGHT_BITS: u32 = 15;
const ONE: i64 = 1 << WEIGHT_BITS;

/// Weights of source samples in target pixels.
#[derive(Default)]
pub(super) struct Axis {
    made_for: Option<(u32, u32, u32)>,
    /// For each target pixel its first sample, and the end of its weights.
    pixels: Vec<(u32, u32)>,
    weights: Vec<u16>,
}

impl Axis {
    /// Makes the weights, unless they are there: from `side` pixels, `pixels` of them per sample,
    /// to `target` pixels. Each number is at least 1 and at most 2¹⁵.
    pub fn fit(&mut self, side: u32, pixels: u32, target: u32) {
        if self.made_for.replace((side, pixels, target)) == Some((side, pixels, target)) {
            return;
        }
        self.pixels.clear();
        self.weights.clear();
        // Positions in 1/(2 · pixels · target) of a sample, so that all of them are whole numbers.
        let last_sample = i64::from(side.div_ceil(pixels) - 1);
        let (side, grown) = (i64::from(side), i64::from(pixels) * i64::from(target));
        let (sample, window) = (2 * grown, 2 * side.max(grown));
        for pixel in 0..i64::from(target) {
            let begin = (2 * pixel + 1) * side - window / 2;
            let first = begin.div_euclid(sample).max(0);
            let last = (begin + window - 1).div_euclid(sample).min(last_sample);
            // The part of the window beyond the edge goes to the sample at the edge. The running
            // sums are rounded, not the weights, so that the last sum is one.
            let mut before = 0;
            for at in first..=last {
                let covered = if at == last { window } else { (at + 1) * sample - begin };
                let sum = (covered * ONE + window / 2) / window;
                self.weights.push((sum - before) as u16);
                before = sum;
            }
            self.pixels.push((first as u32, self.weights.len() as u32));
        }
    }

    /// The first sample of a target pixel, and the weights of the samples from there on.
    pub fn pixel(&self, pixel: usize) -> (usize, &[u16]) {
        let begin = if pixel == 0 { 0 } else { self.pixels[pixel - 1].1 };
        let (first, end) = self.pixels[pixel];
        (first as usize, &self.weights[begin as usize..end as usize])
    }

    /// Where the buffers lie, and their capacities.
    #[cfg(test)]
    pub fn buffers(&self) -> [(usize, usize); 2] {
        let (pixels, weights) = (&self.pixels, &self.weights);
        [
            (pixels.as_ptr() as usize, pixels.capacity()),
            (weights.as_ptr() as usize, weights.capacity()),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn weights(side: u32, pixels: u32, target: u32, pixel: usize) -> (usize, Vec<f64>) {
        let mut axis = Axis::default();
        axis.fit(side, pixels, target);
        let (first, weights) = axis.pixel(pixel);
        (first, weights.iter().map(|&w| f64::from(w) / ONE as f64).collect())
    }

    #[test]
    fn shrinking_is_area_and_growing_is_linear() {
        assert_eq!(weights(4, 1, 4, 2), (2, vec![1.0]));
        assert_eq!(weights(8, 1, 2, 1), (4, vec![0.25; 4]));
        assert_eq!(weights(2, 1, 4, 1), (0, vec![0.75, 0.25]));
        assert_eq!(weights(2, 1, 4, 0), (0, vec![1.0]));
        // Windows of 2.5: a half of the third sample each.
        assert_eq!(
            weights(5, 1, 2, 0).1,
            [0.4, 0.4, 0.2].map(|w| (w * 32768f64).round() / 32768.0)
        );
        // Chroma in the middle between its pixels.
        assert_eq!(weights(4, 2, 4, 1), (0, vec![0.75, 0.25]));
        // Five pixels, three samples: the last one's middle is the image's edge.
        assert_eq!(weights(5, 2, 5, 4), (1, vec![0.25, 0.75]));
    }

    #[test]
    fn weights_sum_to_one_and_stay_inside() {
        let sides = [1, 2, 3, 5, 179, 320, 1000, 4096, 16384];
        for (side, target) in sides.iter().flat_map(|a| sides.iter().map(move |b| (*a, *b))) {
            for pixels in [1, 2] {
                let mut axis = Axis::default();
                axis.fit(side, pixels, target);
                for pixel in 0..target as usize {
                    let (first, weights) = axis.pixel(pixel);
                    assert_eq!(weights.iter().map(|&w| i64::from(w)).sum::<i64>(), ONE);
                    assert!(first + weights.len() <= side.div_ceil(pixels) as usize);
                }
            }
        }
    }
}
