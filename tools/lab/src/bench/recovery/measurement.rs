//! What is measured.

use clap::ValueEnum;

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Measurement {
    /// Starts moved off along or about one axis
    Capture,
    /// No pose at all, under conditions
    Nothing,
    /// Frames that show nothing, in the middle of a run
    Dropouts,
    /// Frames of another scene
    Foreign,
}

impl Measurement {
    pub const ALL: [Measurement; 4] =
        [Measurement::Capture, Measurement::Nothing, Measurement::Dropouts, Measurement::Foreign];

    pub fn name(self) -> &'static str {
        match self {
            Measurement::Capture => "capture",
            Measurement::Nothing => "nothing",
            Measurement::Dropouts => "dropouts",
            Measurement::Foreign => "foreign",
        }
    }
}
