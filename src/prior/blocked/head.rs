//! The head of a blocked prior's file.

use super::super::container::{Container, Covered, Format, PartName, Words};
use super::super::{CoordinateFrame, Extras, PriorError, PriorId, RenderOptions};
use crate::coder_tables::Tables;

/// How a blocked prior starts.
pub const MAGIC: [u8; 4] = Format::Blocked.magic();
/// Most splats of a block.
pub const MAX_BLOCK: usize = 16_384;

/// What errors call the part of the blocks.
const FORMAT: &str = "blocks";
/// Bytes of the part before the blocks' entries, and of an entry.
const FIXED: usize = 5;
const ENTRY: usize = 40;

/// A part of a blocked prior, and where its splats lie.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Block {
    /// Splats.
    pub splats: u32,
    /// Least coordinates of their means.
    pub least: [f32; 3],
    /// Greatest coordinates of their means.
    pub greatest: [f32; 3],
    /// No standard deviation of a splat is greater.
    pub longest: f32,
    /// Bytes in the file.
    pub bytes: u32,
    /// CRC-32 of these.
    pub check: u32,
    /// Where they begin.
    pub offset: u64,
}

/// All that a blocked prior's file holds besides the blocks.
#[derive(Debug)]
pub struct BlockedHead {
    pub sh_degree: u32,
    pub options: RenderOptions,
    pub origin: [f64; 3],
    pub clamps_alpha: bool,
    pub splats: usize,
    pub id: PriorId,
    pub frame: CoordinateFrame,
    pub radius: f32,
    pub blocks: Vec<Block>,
    pub coder_tables: Option<Tables>,
    pub extras: Extras,
}

/// A field at byte `offset` that no writer leaves so.
pub fn refusal(offset: usize, reason: String) -> PriorError {
    PriorError::Field { format: FORMAT, offset: offset as u64, reason }
}

/// The part of the blocks. Their offsets are not written: they follow each other.
pub fn blocks_to_bytes(radius: f32, clamps_alpha: bool, blocks: &[Block]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(FIXED + ENTRY * blocks.len());
    bytes.extend(radius.to_le_bytes());
    bytes.push(clamps_alpha.into());
    for block in blocks {
        let words = [block.bytes, block.check, block.splats];
        bytes.extend(words.into_iter().flat_map(u32::to_le_bytes));
        let floats = block.least.into_iter().chain(block.greatest).chain([block.longest]);
        bytes.extend(floats.flat_map(f32::to_le_bytes));
    }
    bytes
}

impl BlockedHead {
    /// Reads and checks the head of a file of `size` bytes. `bytes` reach to its end, or further.
    pub fn read(bytes: &[u8], size: u64) -> Result<BlockedHead, PriorError> {
        let file = Container::read(bytes, Format::Blocked)?;
        let Covered { options, frame, coder_tables, origin } = Covered::read(&file)?;
        let no_frame = PriorError::Content {
            format: Format::Blocked.text(),
            reason: "no coordinate frame".into(),
        };
        let part = file.required(PartName::BLOCKS)?;
        let end = file.head.end;
        let read = |content: &[u8], at| Listed::read(content, at, end, size);
        let Listed { radius, clamps_alpha, blocks } = part.read_content(read)?;
        let splats = blocks.iter().map(|block| block.splats as usize).sum();
        if splats != file.head.splats as usize {
            let reason = format!("the blocks hold {splats} splats");
            return Err(Format::Blocked.refusal(12, reason));
        }
        Ok(BlockedHead {
            sh_degree: file.head.sh_degree,
            options,
            origin,
            clamps_alpha,
            splats,
            id: file.head.id,
            frame: frame.ok_or(no_frame)?,
            radius,
            blocks,
            coder_tables,
            extras: Extras::read(&file)?,
        })
    }
}

/// What the part of the blocks says.
struct Listed {
    radius: f32,
    clamps_alpha: bool,
    blocks: Vec<Block>,
}

impl Listed {
    /// Reads the part, whose content begins at byte `at`. The blocks begin at byte `offset` of a file of `size`.
    fn read(content: &[u8], at: usize, mut offset: u64, size: u64) -> Result<Listed, PriorError> {
        let mut words = Words::new(content, at);
        let (radius, clamps_alpha) = (words.float()?, words.byte()?);
        if !(radius >= 0.0 && radius.is_finite() && clamps_alpha <= 1) {
            return Err(refusal(at, "no radius, or no yes or no".into()));
        }
        let count = content.len().saturating_sub(FIXED) / ENTRY;
        if count == 0 {
            return Err(PriorError::Empty);
        }
        let mut blocks = Vec::with_capacity(count);
        for _ in 0..count {
            let block = Block::read(&mut words, offset)?;
            offset += u64::from(block.bytes);
            blocks.push(block);
        }
        words.end(FORMAT)?;
        let found = usize::try_from(size).unwrap_or(usize::MAX);
        match offset {
            _ if offset > size => Err(PriorError::Truncated { needed: offset.into(), found }),
            _ if offset < size => Err(refusal(at, format!("they end at byte {offset}"))),
            _ => Ok(Listed { radius, clamps_alpha: clamps_alpha == 1, blocks }),
        }
    }
}

impl Block {
    fn read(words: &mut Words, offset: u64) -> Result<Block, PriorError> {
        let at = words.at();
        let (bytes, check, splats) = (words.word()?, words.word()?, words.word()?);
        let (least, greatest) = (words.floats::<3>()?, words.floats::<3>()?);
        let longest = words.float()?;
        let boxed = (0..3).all(|axis| {
            least[axis].is_finite() && greatest[axis].is_finite() && least[axis] <= greatest[axis]
        });
        let counted = splats > 0 && splats <= bytes && splats as usize <= MAX_BLOCK;
        let block = Block { splats, least, greatest, longest, bytes, check, offset };
        let sound = boxed && counted && longest.is_finite() && longest > 0.0;
        sound.then_some(block).ok_or_else(|| refusal(at, "no block".into()))
    }
}

/// The median, over blocks, of the longest side of their boxes.
pub fn typical_edge(blocks: &[Block]) -> f64 {
    let longest = |block: &Block| {
        let side = |axis: usize| f64::from(block.greatest[axis]) - f64::from(block.least[axis]);
        (0..3).map(side).fold(0.0, f64::max)
    };
    let mut edges: Vec<f64> = blocks.iter().map(longest).collect();
    edges.sort_unstable_by(f64::total_cmp);
    edges.get(edges.len() / 2).copied().unwrap_or(0.0)
}
