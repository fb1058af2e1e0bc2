//! Writing a blocked prior.

use std::io::Write;

use super::super::compact::{Coded, Quantisation};
use super::super::container::{Format, Head, PartName};
use super::super::identity::identity_of;
use super::super::{Besides, CoordinateFrame, PriorError, PriorId, RenderOptions, Splats};
use super::divide::{divide, longest_log_scale};
use super::head::{Block, MAX_BLOCK, blocks_to_bytes, typical_edge};
use crate::shared::ALPHA_MIN;

/// How a blocked prior is written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlockedWriter {
    /// How coarsely. Steps of positions are four times the share of a block's spread.
    pub quantisation: Quantisation,
    /// Most splats of a block, at least 1, at most [`MAX_BLOCK`].
    pub block: usize,
}

/// Blocks are about so many times narrower than the priors that the steps of positions were chosen for.
const NARROWER: f32 = 4.0;

impl Default for BlockedWriter {
    fn default() -> BlockedWriter {
        BlockedWriter { quantisation: Quantisation::default(), block: 4096 }
    }
}

/// What was written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlockedSummary {
    /// Identity of the prior that readers get.
    pub id: PriorId,
    /// Splats.
    pub splats: usize,
    /// Splats that no picture shows, which were left out.
    pub unseen: usize,
    /// Blocks.
    pub blocks: usize,
    /// Bytes of the file.
    pub bytes: u64,
}

/// Whether a splat's alpha may exceed the clamp. Rounding may raise an alpha a little above its splat's opacity.
pub fn is_clamped(splats: &Splats, index: usize, options: &RenderOptions) -> bool {
    splats.opacity(index) as f32 > options.alpha_max * (1.0 - 1e-5)
}

/// Standard deviation that none of the splats exceeds.
pub fn longest(splats: &Splats) -> f32 {
    let all = (0..splats.len() as u32).map(|index| longest_log_scale(splats, index));
    let longest = libm::exp(all.fold(f32::NEG_INFINITY, f32::max).into());
    // Rounded up.
    (longest * (1.0 + 1e-6)) as f32
}

impl BlockedWriter {
    /// Writes a prior. Takes host memory for the splats three times. `done` is called with the number of splats
    /// written, after each block.
    ///
    /// # Errors
    /// If the quantisation or the size of blocks is out of its range, if there is no splat, if one is invalid or one of
    /// its values too large for its step, or if `writer` fails.
    pub fn write(
        &self,
        splats: &Splats,
        besides: &Besides,
        mut writer: impl Write,
        done: &mut dyn FnMut(usize),
    ) -> Result<BlockedSummary, PriorError> {
        besides.check(splats)?;
        if self.block == 0 || self.block > MAX_BLOCK {
            return Err(PriorError::BlockSize { size: self.block, most: MAX_BLOCK });
        }
        let position = (NARROWER * self.quantisation.position).min(1.0);
        let quantisation = Quantisation { position, ..self.quantisation };
        quantisation.check()?;
        let Coding { kept, order, blocks, bytes } =
            Coding::of(splats, self.block, &quantisation, done)?;
        let (options, unseen) = (besides.options, splats.len() - kept.len());
        let frame = frame_of(&kept, &blocks);
        let id = identity_of(&kept, options, Some(&frame), besides.coder_tables);
        let extras = besides.extras.reordered(&order);
        let besides = Besides { frame: Some(&frame), extras: &extras, ..*besides };
        let head = Head::new(Format::Blocked, kept.sh_degree, kept.len(), id);
        let mut file = besides.file(head, kept.origin);
        let clamps_alpha = (0..kept.len()).any(|index| is_clamped(&kept, index, options));
        let radius = frame.radius_of(&kept.positions);
        file.set(PartName::BLOCKS, Some(blocks_to_bytes(radius, clamps_alpha, &blocks)));
        let head = file.to_bytes();
        let written = writer.write_all(&head).and_then(|()| writer.write_all(&bytes));
        written.and_then(|()| writer.flush()).map_err(PriorError::Write)?;
        Ok(BlockedSummary {
            id,
            splats: kept.len(),
            unseen,
            blocks: blocks.len(),
            bytes: (head.len() + bytes.len()) as u64,
        })
    }
}

/// Splats in blocks.
struct Coding {
    /// As readers get them.
    kept: Splats,
    /// Which of the splats given stands at each place.
    order: Vec<u32>,
    blocks: Vec<Block>,
    bytes: Vec<u8>,
}

impl Coding {
    fn of(
        splats: &Splats,
        most: usize,
        quantisation: &Quantisation,
        done: &mut dyn FnMut(usize),
    ) -> Result<Coding, PriorError> {
        let sh_degree = splats.needed_sh_degree();
        let visible = |i: &u32| splats.opacity(*i as usize) as f32 >= ALPHA_MIN;
        let mut shown: Vec<u32> = (0..splats.len() as u32).filter(visible).collect();
        if shown.is_empty() {
            // A blocked prior has one splat at least; this one shows nothing.
            shown.push(0);
        }
        let mut coding = Coding {
            kept: Splats { sh_degree, origin: splats.origin, ..Splats::default() },
            order: Vec::new(),
            blocks: Vec::new(),
            bytes: Vec::new(),
        };
        for which in divide(splats, shown, most) {
            let (coded, places) = Coded::of(&splats.picked(&which, sh_degree), quantisation)?;
            let mut own = Splats { origin: splats.origin, ..coded.splats() };
            let bytes = coded.to_bytes()?;
            coding.blocks.push(Block::of(&own, &bytes));
            coding.kept.append(&mut own);
            coding.order.extend(places.iter().map(|place| which[*place as usize]));
            coding.bytes.extend(bytes);
            done(coding.kept.len());
        }
        Ok(coding)
    }
}

/// Steps of a camera's centre in a compact packet, of 24 bits, reach so many units of the coordinate frame.
const REACH: f64 = 64.0;
/// Share of the splats that lie where cameras go. The others are strays.
const NEARLY_ALL: f64 = 0.98;

/// The frame in which packets state cameras. Its unit would grow with a site that is much larger than what a camera
/// sees, and the steps of poses with it. So it is that of a block, unless the steps then do not reach across the site.
fn frame_of(splats: &Splats, blocks: &[Block]) -> CoordinateFrame {
    let frame = CoordinateFrame::of(&splats.positions);
    let nearly_all = (NEARLY_ALL * (splats.len() - 1) as f64) as usize;
    let mut distances: Vec<f32> =
        splats.positions.iter().map(|position| frame.radius_of([position])).collect();
    let (_, across, _) = distances.select_nth_unstable_by(nearly_all, f32::total_cmp);
    let local = typical_edge(blocks).max(f64::from(*across) / REACH) as f32;
    let spread = if local > 0.0 { frame.spread.min(local) } else { frame.spread };
    CoordinateFrame { spread, ..frame }
}

impl Block {
    /// The block of these splats, of which there is at least one, in these bytes. Its place in the file is open.
    fn of(splats: &Splats, bytes: &[u8]) -> Block {
        let (mut least, mut greatest) = (splats.positions[0], splats.positions[0]);
        for position in &splats.positions {
            for axis in 0..3 {
                least[axis] = least[axis].min(position[axis]);
                greatest[axis] = greatest[axis].max(position[axis]);
            }
        }
        Block {
            splats: splats.len() as u32,
            least,
            greatest,
            longest: longest(splats),
            bytes: bytes.len() as u32,
            check: crc32fast::hash(bytes),
            offset: 0,
        }
    }
}
