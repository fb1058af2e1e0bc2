//! How alike pictures look: SSIM and MS-SSIM of the luma, as in Wang's MATLAB scripts.

use blazediff_ssim::{MsSsimOptions, Plane, Rgba8, SsimError, SsimOptions, ms_ssim, ssim};
use nvsprior::Picture;

/// Means over pictures; `None` if these are too small for the measure, or if it has no value for one.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Similarity {
    pub ssim: Option<f64>,
    /// Five scales: the shorter side has at least 176 pixels.
    pub ms_ssim: Option<f64>,
}

impl Similarity {
    /// Of pictures one by one, each pair of one size.
    pub fn of(frames: &[Picture], shown: &[Picture]) -> Similarity {
        let mean = |score: &dyn Fn(&Plane, &Plane) -> Result<f64, SsimError>| {
            let scores = frames.iter().zip(shown).map(|(frame, shown)| {
                let score = score(&luma(frame)?, &luma(shown)?)?;
                Ok::<f64, SsimError>(score)
            });
            let sum = scores.sum::<Result<f64, SsimError>>().ok()?;
            let mean = sum / frames.len() as f64;
            mean.is_finite().then_some(mean)
        };
        let options = SsimOptions::default();
        Similarity {
            ssim: mean(&|a, b| Ok(ssim(a, b, &options)?.score)),
            ms_ssim: mean(&|a, b| Ok(ms_ssim(a, b, &options, &MsSsimOptions::default())?.score)),
        }
    }
}

fn luma(picture: &Picture) -> Result<Plane, SsimError> {
    let pixels = picture.data.as_chunks::<3>().0.iter();
    let rgba: Vec<u8> = pixels.flat_map(|&[r, g, b]| [r, g, b, 255]).collect();
    Plane::from_rgba8(Rgba8::new(&rgba, picture.width as usize, picture.height as usize))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn waves(width: u32, height: u32, noise: u32) -> Picture {
        let value = |i: u32| {
            let (x, y) = (f64::from(i % width), f64::from(i / width));
            let wave = 128.0 + 60.0 * (0.1 * x).sin() * (0.17 * y).cos();
            let noise = (i.wrapping_mul(2_654_435_761) >> 24) % (noise + 1);
            [wave as u8 + noise as u8; 3]
        };
        let data = (0..width * height).flat_map(value).collect();
        Picture::from_rgb(width, height, data).expect("its size")
    }

    #[test]
    fn noise_makes_pictures_less_alike() {
        let clean = [waves(320, 180, 0)];
        let same = Similarity::of(&clean, &clean);
        assert!(same.ssim.unwrap() > 0.9999 && same.ms_ssim.unwrap() > 0.9999, "{same:?}");
        let [some, more] = [10, 60].map(|n| Similarity::of(&clean, &[waves(320, 180, n)]));
        assert!(some.ssim.unwrap() > more.ssim.unwrap() && some.ssim < same.ssim);
        assert!(some.ms_ssim.unwrap() > more.ms_ssim.unwrap() && some.ms_ssim < same.ms_ssim);
    }

    #[test]
    fn small_pictures_have_no_value() {
        let [small, tiny] = [[waves(160, 90, 0)], [waves(8, 8, 0)]];
        let small = Similarity::of(&small, &small);
        assert!(small.ssim.is_some() && small.ms_ssim.is_none());
        assert_eq!(Similarity::of(&tiny, &tiny), Similarity { ssim: None, ms_ssim: None });
    }
}
