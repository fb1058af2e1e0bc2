//! What the encoder holds for a good picture: an argument of `encode`, `link` and `vehicle`.

use clap::ValueEnum;
use nvsprior::residual::Tune;

#[derive(clap::Args)]
pub struct TuneArgs {
    /// What counts when bits are given to one part of the picture and taken from another. `psnr`: all squared errors
    /// alike; `ssim`: errors less where texture hides them; `detection`: errors more where the prior is far from the
    /// picture, so that new things show first. --psnr stays the PSNR
    #[arg(long, value_enum, default_value = "psnr")]
    tune: TuneArg,
}

#[derive(Clone, Copy, ValueEnum)]
enum TuneArg {
    Psnr,
    Ssim,
    Detection,
}

impl TuneArgs {
    pub fn tune(&self) -> Tune {
        match self.tune {
            TuneArg::Psnr => Tune::Psnr,
            TuneArg::Ssim => Tune::Ssim,
            TuneArg::Detection => Tune::Detection,
        }
    }
}
