//! Whether frames are predicted from earlier ones: an argument of `encode`, `link` and `vehicle`.

use std::str::FromStr;

use nvsprior::{Mode, Structure};

use crate::values;

/// Whether frames are predicted from earlier ones.
#[derive(clap::Args)]
pub struct ModeArgs {
    /// `intra`: intra frames alone. All others have inter frames, too, which are predicted from a reference frame and
    /// take fewer bytes; one whose reference is missing is shown as the render alone. The reference of `stream`, or
    /// `chain`: the frame before; of `layers`: for every other frame one further back, so that fewer depend on each; of
    /// `keys`: the last intra frame; of `acknowledged`: the newest one that the topside says it has, over a return
    /// channel. N: an intra frame every N frames, so that a loss ends there; 16 if it is left out; 0: no more after the
    /// first
    #[arg(long, value_name = "MODE[:N]", default_value = "intra")]
    mode: ModeArg,
}

/// Frames from one intra frame to the next, if that is not stated.
const KEY_EVERY: u32 = 16;

#[derive(Clone, Copy)]
struct ModeArg(Mode);

impl FromStr for ModeArg {
    type Err = String;

    fn from_str(text: &str) -> Result<ModeArg, String> {
        let (name, every) = text.split_once(':').map_or((text, None), |(name, n)| (name, Some(n)));
        let key_every = every.map_or(Ok(KEY_EVERY), |n| {
            n.parse().map_err(|_| format!("\"{n}\" is no number of frames"))
        })?;
        Ok(ModeArg(match (name, every) {
            ("intra", None) => Mode::Intra,
            ("acknowledged", None) => Mode::Stream(Structure::Acknowledged),
            ("stream" | "chain", _) => Mode::Stream(Structure::Chain { key_every }),
            ("layers", _) => Mode::Stream(Structure::Layers { key_every }),
            ("keys", _) => Mode::Stream(Structure::Keys { key_every }),
            _ => {
                let known = "intra, stream[:N], chain[:N], layers[:N], keys[:N], acknowledged";
                return Err(format!("there are {known}"));
            }
        }))
    }
}

impl ModeArgs {
    /// The encoder's mode. `expect_reports`: there is a topside that acknowledges frames.
    ///
    /// # Errors
    /// If frames are to be predicted from acknowledged ones, and nothing acknowledges any.
    pub fn mode(&self, expect_reports: bool) -> Result<Mode, values::WrongUsage> {
        match self.mode.0 {
            Mode::Stream(Structure::Acknowledged) if !expect_reports => {
                let text = "--mode acknowledged: nothing acknowledges frames; it needs \
                            `nvsprior link --return-delay`";
                Err(values::WrongUsage(text.into()))
            }
            mode => Ok(mode),
        }
    }
}
