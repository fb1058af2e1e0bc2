//! What a payload says first.

use super::geometry::{Finest, MAX_LEVELS};
use super::small_blocks::SmallBlocks;
use super::step::Step;
use crate::coder_tables::PLANES;
use crate::range_coder::{EVEN, Probability, RangeDecoder, RangeEncoder};

/// What the coefficients are read with.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Header {
    /// The bytes are the start of a longer stream.
    pub cut: bool,
    /// Contexts look at the render: it must be the same on both sides, byte for byte.
    pub sees_render: bool,
    pub step: Step,
    /// What is coded at all.
    pub finest: Finest,
    /// The coarsest low band is predicted from the render.
    pub low_predicted: bool,
}

/// Chances: that a stream is cut; that contexts do not see the render; that the low band is not predicted; that
/// some blocks are not.
const CUT: Probability = 1 << 14;
const BLIND: Probability = 1 << 11;
const LOW_PLAIN: Probability = 1 << 11;
const SOME_BLOCKS: Probability = 1 << 12;

impl Header {
    /// Writes it, and which blocks are predicted: the small ones, if they are in use.
    pub fn write(&self, blocks: &[bool], small: &SmallBlocks, encoder: &mut RangeEncoder) {
        encoder.put(self.cut, CUT);
        encoder.put(!self.sees_render, BLIND);
        encoder.put(!self.low_predicted, LOW_PLAIN);
        put_number(encoder, u32::from(self.step.index()), 6);
        for level in self.finest {
            put_number(encoder, level as u32, 3);
        }
        if small.in_use {
            return small.write(encoder);
        }
        let some = blocks.contains(&false);
        encoder.put(some, SOME_BLOCKS);
        if some {
            write_blocks(blocks, encoder);
        }
    }

    pub fn read(
        blocks: &mut [bool],
        small: &mut SmallBlocks,
        decoder: &mut RangeDecoder,
    ) -> Option<Header> {
        let cut = decoder.get(CUT)?;
        let sees_render = !decoder.get(BLIND)?;
        let low_predicted = !decoder.get(LOW_PLAIN)?;
        let step = Step::new(get_number(decoder, 6)? as u8);
        let mut finest = [0; PLANES];
        for level in &mut finest {
            *level = get_number(decoder, 3)? as usize;
        }
        blocks.fill(true);
        if small.in_use {
            small.read(decoder)?;
        } else if decoder.get(SOME_BLOCKS)? {
            read_blocks(blocks, decoder)?;
        }
        Some(Header { cut, sees_render, step, finest, low_predicted })
    }
}

const _: () = assert!(MAX_LEVELS + 1 < 8);

/// Writes a bit of each block.
pub fn write_blocks(blocks: &[bool], encoder: &mut RangeEncoder) {
    let mut chance = BlockChance::new();
    for predicted in blocks {
        encoder.put(*predicted, chance.one());
        chance.learn(*predicted);
    }
}

pub fn read_blocks(blocks: &mut [bool], decoder: &mut RangeDecoder) -> Option<()> {
    let mut chance = BlockChance::new();
    for predicted in blocks {
        *predicted = decoder.get(chance.one())?;
        chance.learn(*predicted);
    }
    Some(())
}

/// Chance that the next block is predicted, by how many were.
struct BlockChance {
    predicted: u32,
    all: u32,
}

impl BlockChance {
    fn new() -> BlockChance {
        BlockChance { predicted: 1, all: 2 }
    }

    fn one(&self) -> Probability {
        (65_536 * u64::from(self.predicted) / u64::from(self.all)) as Probability
    }

    fn learn(&mut self, predicted: bool) {
        self.predicted += u32::from(predicted);
        self.all += 1;
    }
}

fn put_number(encoder: &mut RangeEncoder, number: u32, bits: u32) {
    for bit in (0..bits).rev() {
        encoder.put(number >> bit & 1 > 0, EVEN);
    }
}

fn get_number(decoder: &mut RangeDecoder, bits: u32) -> Option<u32> {
    (0..bits).try_fold(0, |number, _| Some(number << 1 | u32::from(decoder.get(EVEN)?)))
}
