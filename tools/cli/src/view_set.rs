//! Views at which a reduced prior's pictures are compared with the whole one's.

use nvsprior::{Camera, Picture, Pose};

use crate::mission::{PosedFrame, places, spaced};
use crate::picture_renderer::PictureRenderer;

/// Equal pictures count as this, dB.
const EQUAL: f64 = 100.0;

/// Estimates the loss against frames that are not there. Assumes that they differ from the whole
/// prior's pictures by `fidelity`, and that this is independent of the reduced prior's difference,
/// `psnr`. All in dB.
pub fn expected_loss(fidelity: f64, psnr: f64) -> f64 {
    10.0 * (1.0 + 10_f64.powf((fidelity - psnr) / 10.0)).log10()
}

/// Views with the whole prior's pictures.
pub struct ViewSet {
    pub places: Vec<(Camera, Pose)>,
    pictures: Vec<Picture>,
    /// The camera's, if every view has one.
    pub frames: Option<Vec<Picture>>,
}

impl ViewSet {
    pub fn new(
        places: Vec<(Camera, Pose)>,
        frames: Option<Vec<Picture>>,
        whole: &mut PictureRenderer,
    ) -> anyhow::Result<ViewSet> {
        let pictures = whole.render_all(&places)?;
        Ok(ViewSet { places, pictures, frames })
    }

    /// A set of at most `max` views, evenly spaced.
    pub fn of(
        sights: &[PosedFrame],
        max: usize,
        whole: &mut PictureRenderer,
    ) -> anyhow::Result<ViewSet> {
        let frames = spaced(sights, max).map(|sight| sight.frame.clone()).collect();
        ViewSet::new(places(spaced(sights, max)), frames, whole)
    }

    /// PSNR of a prior's pictures against the whole one's, and their loss against the frames, as means over the views;
    /// NaN if there are none.
    pub fn compare(&self, small: &mut PictureRenderer) -> anyhow::Result<(f64, f64)> {
        let (mut psnr, mut loss) = (0.0, 0.0);
        for (i, (camera, pose)) in self.places.iter().enumerate() {
            let picture = small.render(camera, pose)?;
            psnr += picture.psnr(&self.pictures[i]).min(EQUAL);
            loss += self.frames.as_ref().map_or(f64::NAN, |frames| {
                let of = |picture: &Picture| picture.psnr(&frames[i]).min(EQUAL);
                of(&self.pictures[i]) - of(picture)
            });
        }
        let count = self.places.len() as f64;
        Ok((psnr / count, loss / count))
    }

    /// PSNR of the whole prior's pictures against the frames, mean over the views, dB.
    pub fn fidelity(&self) -> Option<f64> {
        let frames = self.frames.as_ref()?;
        let all = std::iter::zip(&self.pictures, frames);
        let sum: f64 = all.map(|(picture, frame)| picture.psnr(frame).min(EQUAL)).sum();
        Some(sum / frames.len() as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_as_large_as_the_frames_own_costs_three_decibels() {
        assert!((expected_loss(27.0, 27.0) - 3.0103).abs() < 1e-4);
        assert!((expected_loss(27.0, 43.0) - 0.1077).abs() < 1e-3);
        assert_eq!(expected_loss(27.0, f64::INFINITY), 0.0);
    }
}
