//! What training the tables needs: the inputs and outcomes of a coded frame.

use super::fineness::LAMBDA;
use super::{Step, WaveletEncoder};
use crate::coder_tables::Tables;
use crate::coder_tables::networks::{MAGNITUDE_INPUTS, SIGN_INPUTS};

pub use super::bits::UNARY;
pub use super::inter::Pays;

/// One coefficient that was coded.
pub struct Sample {
    /// Inputs of the network for magnitudes.
    pub magnitude: [i16; MAGNITUDE_INPUTS],
    /// Inputs of the one for signs.
    pub sign: [i16; SIGN_INPUTS],
    /// Rank, orientation and plane of its band.
    pub band: [u8; 3],
    /// Its value.
    pub value: i16,
    /// What was to be coded, steps.
    pub wanted: f32,
}

/// Codes frames, and shows what was coded.
pub struct Sampler {
    encoder: WaveletEncoder,
    has_small_blocks: bool,
}

impl Sampler {
    /// For pictures of a size, coded with tables.
    pub fn new(width: u32, height: u32, tables: &Tables) -> Sampler {
        let encoder = WaveletEncoder::new(width, height, tables);
        Sampler { encoder, has_small_blocks: false }
    }

    /// For inter frames, too.
    pub fn with_stream(mut self, tables: &Tables) -> Sampler {
        self.encoder.set_stream_tables(tables);
        self
    }

    /// Sets whether frames have small blocks from here on. At first they have none.
    pub fn set_small_blocks(&mut self, has: bool) {
        self.has_small_blocks = has;
    }

    /// The encoder.
    pub fn encoder(&mut self) -> &mut WaveletEncoder {
        &mut self.encoder
    }

    /// Codes the frame that the encoder was set to, and shows its coefficients in coding order.
    pub fn visit(&mut self, step: Step, mut visit: impl FnMut(Sample)) {
        if self.has_small_blocks {
            self.encoder.choose_blocks(step);
        }
        self.encoder.choose(step, LAMBDA);
        self.encoder.show(|due, value, wanted| {
            let context = due.context;
            let (rank, orientation) = (context.band.rank(), context.band.orientation.index());
            visit(Sample {
                magnitude: first(due.magnitude_inputs().as_flattened()),
                sign: first(due.sign_inputs().as_flattened()),
                band: [rank, orientation, context.plane].map(|v| v as u8),
                value,
                wanted,
            });
        });
    }
}

/// Without what fills the last pair.
fn first<const N: usize>(inputs: &[i16]) -> [i16; N] {
    std::array::from_fn(|i| inputs[i])
}
