//! Learnt splats that do harm: what they showed has gone, or looks different from here.

use crate::Picture;
use crate::prior::LearntSplat;

use super::key_frame::KeyFrame;

/// How far around a splat pictures are compared, in its largest standard deviations.
const REACH: f64 = 1.5;
/// A splat does harm if the mean squared error around it grows by more than this, values up to 255.
const HARM: f64 = 30.0;

/// What each learnt splat does to the error around it.
pub struct Harms<'a> {
    splats: &'a [LearntSplat],
    /// Sum of the differences of squared errors, and how many there are.
    sums: Vec<(f64, u32)>,
}

impl Harms<'_> {
    pub fn new(splats: &[LearntSplat]) -> Harms<'_> {
        Harms { splats, sums: vec![(0.0, 0); splats.len()] }
    }

    /// Compares a frame's renders with what is learnt and without.
    pub fn add(&mut self, key: &KeyFrame, with: &Picture, without: &Picture) {
        let (width, height) = (f64::from(key.camera.width), f64::from(key.camera.height));
        for (splat, (sum, count)) in self.splats.iter().zip(&mut self.sums) {
            let Some(([x, y], z)) = key.seen(splat.centre()) else {
                continue;
            };
            let size = splat.log_scale.iter().fold(f32::MIN, |a, b| a.max(*b)).exp();
            let reach = (REACH * f64::from(size) * f64::from(key.camera.fx) / z).max(1.0);
            let range = |middle: f64, end: f64| {
                let [first, last] = [middle - reach, middle + reach].map(|v| v.clamp(0.0, end));
                first as usize..last as usize
            };
            for row in range(y, height) {
                for column in range(x, width) {
                    let pixel = row * key.camera.width as usize + column;
                    if key.counts(pixel) {
                        let [a, b] = [with, without].map(|render| key.error(render, pixel));
                        *sum += a - b;
                        *count += 1;
                    }
                }
            }
        }
    }

    /// The places of those that do harm, in rising order.
    pub fn harmful(&self) -> Vec<u16> {
        let harms = |(sum, count): &(f64, u32)| *count > 0 && *sum > HARM * f64::from(*count);
        (0..).zip(&self.sums).filter(|(_, sum)| harms(sum)).map(|(place, _)| place).collect()
    }
}
