//! The head of a blocked prior's file.

use super::super::compact::{self, Besides};
use super::super::limits::MAX_SPLATS;
use super::super::{CoordinateFrame, PriorError, PriorId, RenderOptions, Splats};

/// How a blocked prior starts.
pub const MAGIC: [u8; 4] = *b"nvsb";
/// Most splats of a block.
pub const MAX_BLOCK: usize = 16_384;

const FORMAT: &str = "blocked prior";
const VERSION: u8 = 1;
/// Bytes before the blocks' entries.
const FIXED: usize = 68;
/// Bytes of an entry.
const ENTRY: usize = 36;
/// Bytes of the check at the end.
const CHECK: usize = 4;
/// Bytes that tell the size of the head.
pub const START: usize = 12;

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
    /// Where they begin.
    pub offset: u64,
}

/// All that a blocked prior's file holds besides the blocks.
pub struct Head {
    pub sh_degree: u32,
    pub options: RenderOptions,
    pub clamps_alpha: bool,
    pub splats: usize,
    pub id: PriorId,
    pub frame: CoordinateFrame,
    pub radius: f32,
    pub blocks: Vec<Block>,
    pub besides: Besides,
}

impl std::fmt::Debug for Head {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "blocked prior {} of {} splats in {} blocks",
            self.id,
            self.splats,
            self.blocks.len()
        )
    }
}

/// A field at byte `offset` that no writer leaves so.
pub fn refusal(offset: usize, reason: String) -> PriorError {
    PriorError::Field { format: FORMAT, offset: offset as u64, reason }
}

/// Little-endian numbers of a head.
struct Words<'a>(&'a [u8]);

impl Words<'_> {
    fn word(&self, at: usize) -> u32 {
        u32::from_le_bytes(std::array::from_fn(|i| self.0[at + i]))
    }

    fn float(&self, at: usize) -> f32 {
        f32::from_bits(self.word(at))
    }

    fn triple(&self, at: usize) -> [f32; 3] {
        [0, 4, 8].map(|more| self.float(at + more))
    }
}

impl Head {
    /// Bytes of the head of a file of `size` bytes.
    pub fn bytes_of(start: &[u8; START], size: u64) -> Result<usize, PriorError> {
        if start[..4] != MAGIC {
            return Err(PriorError::UnknownFormat);
        }
        if start[4] != VERSION {
            let (version, known) = (start[4].into(), VERSION.into());
            return Err(PriorError::Newer { format: FORMAT, version, known });
        }
        let bytes = Words(start).word(8);
        if (bytes as usize) < FIXED + ENTRY + CHECK {
            return Err(refusal(8, format!("a head of {bytes} bytes")));
        }
        if u64::from(bytes) > size {
            return Err(PriorError::Truncated { needed: bytes.into(), found: size as usize });
        }
        Ok(bytes as usize)
    }

    /// As in a file. The offsets of the blocks are not written: they follow each other.
    pub fn to_bytes(&self) -> Vec<u8> {
        let Besides { preprocessing, key_frames, coder_tables } = &self.besides;
        let rest = compact::besides_to_bytes(preprocessing, key_frames, coder_tables.as_ref());
        let flags = u8::from(!key_frames.is_empty())
            | u8::from(coder_tables.is_some()) << 1
            | u8::from(!preprocessing.is_none()) << 2
            | u8::from(self.clamps_alpha) << 3;
        let mut bytes = MAGIC.to_vec();
        bytes.extend([VERSION, self.sh_degree as u8, self.options.antialiased.into(), flags]);
        let size = FIXED + ENTRY * self.blocks.len() + rest.len() + CHECK;
        bytes.extend((size as u32).to_le_bytes());
        bytes.extend(self.id.to_bytes());
        bytes.extend((self.splats as u64).to_le_bytes());
        bytes.extend((self.blocks.len() as u32).to_le_bytes());
        let options = [self.options.near, self.options.alpha_max];
        let floats = options.into_iter().chain(self.options.background).chain(self.frame.centre);
        let floats = floats.chain([self.frame.spread, self.radius]);
        bytes.extend(floats.flat_map(f32::to_le_bytes));
        for block in &self.blocks {
            bytes.extend([block.bytes, block.splats].into_iter().flat_map(u32::to_le_bytes));
            let floats = block.least.into_iter().chain(block.greatest).chain([block.longest]);
            bytes.extend(floats.flat_map(f32::to_le_bytes));
        }
        bytes.extend(rest);
        bytes.extend(crc32fast::hash(&bytes).to_le_bytes());
        bytes
    }

    /// Reads and checks the head of a file of `size` bytes. `bytes`: as many as [`Head::bytes_of`] says.
    pub fn read(bytes: &[u8], size: u64) -> Result<Head, PriorError> {
        let (content, check) = bytes.split_at(bytes.len() - CHECK);
        let (stated, found) = (Words(check).word(0), crc32fast::hash(content));
        if stated != found {
            return Err(PriorError::Damaged { stated, found });
        }
        let words = Words(content);
        let sh_degree = u32::from(bytes[5]);
        if sh_degree > Splats::MAX_SH_DEGREE {
            return Err(PriorError::ShDegree { degree: sh_degree });
        }
        if bytes[6] > 1 || bytes[7] > 15 {
            return Err(refusal(6, "unknown flags".into()));
        }
        let options = RenderOptions {
            near: words.float(28),
            alpha_max: words.float(32),
            antialiased: bytes[6] == 1,
            background: words.triple(36),
        };
        options.check()?;
        let frame = CoordinateFrame { centre: words.triple(48), spread: words.float(60) };
        let radius = words.float(64);
        let sound = frame.centre.iter().all(|v| v.is_finite())
            && frame.spread > 0.0
            && frame.spread.is_finite()
            && radius >= 0.0
            && radius.is_finite();
        if !sound {
            return Err(refusal(48, "no place and size of a prior".into()));
        }
        let blocks = Head::entries(&words, bytes.len() as u64, size)?;
        let splats = blocks.iter().map(|block| block.splats as usize).sum();
        if u64::from(words.word(16)) | u64::from(words.word(20)) << 32 != splats as u64 {
            return Err(refusal(16, format!("the blocks hold {splats} splats")));
        }
        if splats > MAX_SPLATS {
            return Err(PriorError::TooMany { count: splats });
        }
        let at = FIXED + ENTRY * blocks.len();
        let there = [4, 1, 2].map(|bit| bytes[7] & bit != 0);
        let (besides, own) = compact::read_besides(&content[at..], at, there)?;
        if at + own != content.len() {
            return Err(refusal(at + own, "more bytes than the head has parts".into()));
        }
        let id = PriorId(words.word(12));
        let clamps_alpha = bytes[7] & 8 != 0;
        Ok(Head { sh_degree, options, clamps_alpha, splats, id, frame, radius, blocks, besides })
    }

    /// The entries of the blocks, which lie behind a head of `offset` bytes in a file of `size`.
    fn entries(words: &Words, mut offset: u64, size: u64) -> Result<Vec<Block>, PriorError> {
        let count = words.word(24) as usize;
        if count == 0 {
            return Err(PriorError::Empty);
        }
        if (words.0.len() - FIXED) / ENTRY < count {
            return Err(refusal(24, format!("{count} blocks in a head of {offset} bytes")));
        }
        let mut blocks = Vec::with_capacity(count);
        for at in (0..count).map(|index| FIXED + ENTRY * index) {
            let (bytes, splats) = (words.word(at), words.word(at + 4));
            let (least, greatest) = (words.triple(at + 8), words.triple(at + 20));
            let longest = words.float(at + 32);
            let boxed = (0..3).all(|axis| {
                least[axis].is_finite()
                    && greatest[axis].is_finite()
                    && least[axis] <= greatest[axis]
            });
            let counted = splats > 0 && splats <= bytes && splats as usize <= MAX_BLOCK;
            if !(boxed && counted && longest.is_finite() && longest > 0.0) {
                return Err(refusal(at, "no block".into()));
            }
            if offset + u64::from(bytes) > size {
                let needed = u128::from(offset) + u128::from(bytes);
                return Err(PriorError::Truncated { needed, found: size as usize });
            }
            blocks.push(Block { splats, least, greatest, longest, bytes, offset });
            offset += u64::from(bytes);
        }
        Ok(blocks)
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
