//! What a payload says first.

use super::displaced::DisplacedBlocks;
use super::geometry::{Finest, MAX_LEVELS};
use super::small_blocks::SmallBlocks;
use super::step::Step;
use crate::coder_tables::PLANES;
use crate::range_coder::{Bits, EVEN, Probability, RangeDecoder, RangeEncoder, StartReader};

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

/// Chances: that a stream is cut; that contexts do not see the render; that the low band is not predicted.
const CUT: Probability = 1 << 14;
const BLIND: Probability = 1 << 11;
const LOW_PLAIN: Probability = 1 << 11;
/// Chances, if there are small blocks, that there are displaced ones; and then, that there are plain ones, too.
const DISPLACED: Probability = 1 << 10;
const ALSO_PLAIN: Probability = EVEN;

/// What says finely what a frame is predicted from.
pub struct FineBlocks<'a> {
    pub plain: &'a mut SmallBlocks,
    /// Those of an inter frame.
    pub displaced: Option<&'a mut DisplacedBlocks>,
}

impl FineBlocks<'_> {
    /// Whether a payload says something of them.
    fn in_use(&self) -> bool {
        self.plain.in_use || self.displaced.as_ref().is_some_and(|displaced| displaced.in_use)
    }

    /// Codes them. `None`: there can be no displaced ones.
    fn code(&mut self, coder: &mut impl Bits) -> Option<()> {
        let has_displaced = self.displaced.as_ref().is_some_and(|displaced| displaced.in_use);
        if coder.bit(DISPLACED, has_displaced) {
            let displaced = self.displaced.as_mut()?;
            displaced.in_use = true;
            displaced.code(coder);
            self.plain.in_use = coder.bit(ALSO_PLAIN, self.plain.in_use);
        }
        if self.plain.in_use {
            self.plain.code(coder);
        }
        Some(())
    }
}

impl Header {
    /// Writes it, and the fine blocks if they are in use.
    pub fn write(&self, mut fine: FineBlocks, encoder: &mut RangeEncoder) {
        encoder.put(self.cut, CUT);
        encoder.put(!self.sees_render, BLIND);
        encoder.put(!self.low_predicted, LOW_PLAIN);
        put_number(encoder, u32::from(self.step.index()), 6);
        for level in self.finest {
            put_number(encoder, level as u32, 3);
        }
        if fine.in_use() {
            let _ = fine.code(encoder);
        }
    }

    /// Reads it. `has_fine`: the payload says something of fine blocks.
    pub fn read(
        mut fine: FineBlocks,
        has_fine: bool,
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
        fine.plain.in_use = has_fine;
        fine.displaced.iter_mut().for_each(|displaced| displaced.clear());
        if has_fine {
            let mut reader = StartReader::new(decoder);
            fine.code(&mut reader)?;
            if reader.has_ended {
                return None;
            }
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
