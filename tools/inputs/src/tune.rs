//! What the encoder holds for a good picture: an argument of `encode`, `link` and `vehicle`.

use nvsprior::residual::Tune;

use crate::values::named;

#[derive(clap::Args)]
pub struct TuneArgs {
    /// What counts when bits are given to one part of the picture and taken from another. `psnr`: all squared errors
    /// alike; `ssim`: errors less where texture hides them; `detection`: errors more where the prior is far from the
    /// picture, so that new things show first. `encode --psnr` stays the PSNR
    #[arg(long, default_value = "psnr", value_parser = named(&TUNES))]
    pub tune: Tune,
}

const TUNES: [(&str, Tune); 3] =
    [("psnr", Tune::Psnr), ("ssim", Tune::Ssim), ("detection", Tune::Detection)];
