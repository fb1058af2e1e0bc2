//! Conditions under which frames are looked for.

use nvsprior::Picture;

use super::pixels;

/// A change of the frame that the encoder gets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Condition {
    /// As they are
    Plain,
    /// At a quarter of their brightness
    Dark,
    /// At a fifth of their contrast, raised by 0.3
    LowContrast,
    /// Rolled copies
    Rolled,
    /// Rolled copies, dark
    RolledDark,
    /// Rolled copies in low contrast
    RolledLowContrast,
    /// Blurred by 2 pixels
    Blur,
    /// With marine snow
    Snow,
    /// Darker towards the corners
    Vignette,
    /// Half of the picture covered
    Object,
}

impl Condition {
    pub const ALL: [Condition; 10] = [
        Condition::Plain,
        Condition::Dark,
        Condition::LowContrast,
        Condition::Rolled,
        Condition::RolledDark,
        Condition::RolledLowContrast,
        Condition::Blur,
        Condition::Snow,
        Condition::Vignette,
        Condition::Object,
    ];

    pub fn name(self) -> &'static str {
        match self {
            Condition::Plain => "plain",
            Condition::Dark => "dark",
            Condition::LowContrast => "low contrast",
            Condition::Rolled => "rolled",
            Condition::RolledDark => "rolled + dark",
            Condition::RolledLowContrast => "rolled + low contrast",
            Condition::Blur => "blur",
            Condition::Snow => "marine snow",
            Condition::Vignette => "vignette",
            Condition::Object => "object",
        }
    }

    /// Whether it is of rolled copies of the frames.
    pub fn rolled(self) -> bool {
        use Condition::{Rolled, RolledDark, RolledLowContrast};
        matches!(self, Rolled | RolledDark | RolledLowContrast)
    }

    /// The frame as the encoder gets it. Rolled copies are rolled before this. `other`: another frame of the same size,
    /// from which objects are made.
    pub fn apply(self, clean: &Picture, other: &Picture, seed: u64) -> Picture {
        match self {
            Condition::Plain | Condition::Rolled => clean.clone(),
            Condition::Dark | Condition::RolledDark => pixels::light(clean, 0.25, 0.0),
            Condition::LowContrast | Condition::RolledLowContrast => pixels::light(clean, 0.2, 0.3),
            Condition::Blur => pixels::blurred(clean, 2.0),
            Condition::Snow => pixels::snowy(clean, seed),
            Condition::Vignette => pixels::vignetted(clean, 0.7),
            Condition::Object => pixels::covered(clean, other, seed),
        }
    }
}
