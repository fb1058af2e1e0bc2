//! Whether an update pays: frames that it was not learnt from, coded with it and without.

use crate::packet::{Residual, SHORT_LATENT_LEN, residual_part_len};
use crate::residual::{CodedResidual, ResidualEncoder, ResidualError, ResidualSetup};
use crate::{Picture, Rate};

/// What is aimed at if no difference picture is sent, dB: only to judge.
const UNSENT: f64 = 31.0;

/// Codes frames with two renders.
pub struct Judge {
    coder: ResidualEncoder,
}

/// Bytes of a frame's residual.
fn bytes(coded: &CodedResidual) -> usize {
    match coded.residual {
        Residual::Coded { payload, .. } => residual_part_len(payload.len()),
        _ => 0,
    }
}

impl Judge {
    pub fn new(setup: &ResidualSetup) -> Judge {
        Judge { coder: ResidualEncoder::new(setup) }
    }

    /// Bytes that a frame's difference from its render takes, per squared error of 1 that it takes away: of a pixel,
    /// the mean over its colours, values up to 255.
    pub fn bytes_per_error(
        &mut self,
        frame: &Picture,
        render: &Picture,
        rate: Option<Rate>,
    ) -> Result<f64, ResidualError> {
        let rate = rate.unwrap_or(Rate::Psnr(UNSENT));
        let coded = self.coder.encode(frame, render, rate, SHORT_LATENT_LEN)?;
        let pixels = (frame.data.len() / 3) as f64;
        let error = |picture: &Picture| 255.0 * 255.0 * pixels * picture.mse(frame);
        let gone = error(render) - error(coded.reconstruction);
        Ok(if gone > 0.0 { bytes(&coded) as f64 / gone } else { 0.0 })
    }

    /// Bytes that the render `with` spares a frame beside the render `without`, at the same PSNR.
    pub fn saved(
        &mut self,
        frame: &Picture,
        without: &Picture,
        with: &Picture,
        rate: Option<Rate>,
    ) -> Result<f64, ResidualError> {
        let rate = rate.unwrap_or(Rate::Psnr(UNSENT));
        let before = self.coder.encode(frame, without, rate, SHORT_LATENT_LEN)?;
        let taken = bytes(&before);
        let reached = match rate {
            Rate::Psnr(target) => target,
            _ => before.reconstruction.psnr(frame),
        };
        let after = self.coder.encode(frame, with, Rate::Psnr(reached), SHORT_LATENT_LEN)?;
        Ok(taken as f64 - bytes(&after) as f64)
    }
}

/// Whether an update of so many bytes pays within `horizon` frames, by what it saves on each frame that it was not
/// learnt from. The mean must pay with its standard error taken off, and no more than a quarter of the frames may lose.
pub fn pays(saved: &[f64], update_bytes: usize, horizon: f64) -> bool {
    let count = saved.len() as f64;
    let mean = saved.iter().sum::<f64>() / count;
    let square =
        saved.iter().map(|s| (s - mean) * (s - mean)).sum::<f64>() / (count - 1.0).max(1.0);
    let sure = mean - (square / count).sqrt();
    let losing = saved.iter().filter(|saved| **saved < 0.0).count();
    saved.len() >= 2 && 4 * losing <= saved.len() && sure * horizon > update_bytes as f64
}

#[cfg(test)]
mod tests {
    use super::pays;

    #[test]
    fn an_update_pays_if_it_saves_more_than_it_takes() {
        assert!(pays(&[100.0, 90.0, 110.0], 800, 60.0));
        assert!(!pays(&[10.0, 9.0, 11.0], 800, 60.0), "too little");
        assert!(!pays(&[100.0], 800, 60.0), "one frame says nothing");
        assert!(!pays(&[300.0, -40.0], 800, 60.0), "half of the frames lose");
        assert!(!pays(&[200.0, 1.0, 2.0], 800, 12.0), "one frame alone wins");
        assert!(!pays(&[], 0, 60.0));
    }
}
