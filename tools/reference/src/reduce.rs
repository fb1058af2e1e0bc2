//! Twin of stage `reduce`: the normal equations of all pixels and channels.

use nvsprior::render::{NormalEquations, counts};

use super::Sample;

/// Sums over samples in order; `frame` has three floats per sample. Masked samples are only counted.
pub fn reduce(samples: &[Sample], frame: &[f32]) -> NormalEquations {
    let mut sums = NormalEquations { jtj: [[0.0; 6]; 6], jtr: [0.0; 6], square: 0.0, residuals: 0 };
    for (sample, target) in samples.iter().zip(frame.chunks_exact(3)) {
        if !counts(target[0]) {
            sums.residuals += 3;
            continue;
        }
        for (channel, d) in sample.jacobian.iter().enumerate() {
            let residual = sample.rgb[channel] - f64::from(target[channel]);
            for row in 0..6 {
                for column in 0..6 {
                    sums.jtj[row][column] += d[row] * d[column];
                }
                sums.jtr[row] += d[row] * residual;
            }
            sums.square += residual * residual;
            sums.residuals += 1;
        }
    }
    sums
}
