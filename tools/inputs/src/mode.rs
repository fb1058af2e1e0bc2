//! Whether frames are predicted from earlier ones: arguments of `encode` and `link`.

use clap::ValueEnum;
use nvsprior::{Mode, Structure};

use crate::values;

/// Whether frames are predicted from earlier ones.
#[derive(clap::Args)]
pub struct ModeArgs {
    /// `intra`: intra frames alone; `stream`: inter frames too, which are predicted from earlier ones and take fewer
    /// bytes. A frame whose reference is missing is shown as the render alone. Needs the wavelet coder
    #[arg(long, value_enum, default_value = "intra")]
    mode: ModeArg,
    /// Of a stream: an intra frame every N frames, so that a loss ends there; 0: no more after the first
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = values::count)]
    key_every: usize,
    /// Of a stream: the reference of inter frames. `chain`: the frame before; `layers`: for every other frame one
    /// further back, so that fewer depend on each; `keys`: the last intra frame; `acknowledged`: the newest one that
    /// the topside says it has, over a return channel
    #[arg(long, value_enum, default_value = "chain")]
    structure: StructureArg,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum ModeArg {
    Intra,
    Stream,
}

#[derive(Clone, Copy, ValueEnum)]
enum StructureArg {
    Chain,
    Layers,
    Keys,
    Acknowledged,
}

impl ModeArgs {
    /// The encoder's mode. `expect_reports`: there is a topside that acknowledges frames.
    ///
    /// # Errors
    /// If frames are to be predicted from acknowledged ones, and nothing acknowledges any.
    pub fn mode(&self, expect_reports: bool) -> Result<Mode, values::WrongUsage> {
        let key_every = self.key_every.try_into().unwrap_or(0);
        Ok(match (self.mode, self.structure) {
            (ModeArg::Intra, _) => Mode::Intra,
            (_, StructureArg::Chain) => Mode::Stream(Structure::Chain { key_every }),
            (_, StructureArg::Layers) => Mode::Stream(Structure::Layers { key_every }),
            (_, StructureArg::Keys) => Mode::Stream(Structure::Keys { key_every }),
            (_, StructureArg::Acknowledged) if expect_reports => {
                Mode::Stream(Structure::Acknowledged)
            }
            (_, StructureArg::Acknowledged) => {
                let text = "--structure acknowledged: nothing acknowledges frames; it needs \
                            `nvsprior link --return-delay`";
                return Err(values::WrongUsage(text.into()));
            }
        })
    }
}
