//! Writing a blocked prior.

use std::io::Write;

use super::super::compact::{self, Besides, Quantisation};
use super::super::identity::identity_of;
use super::super::{CoordinateFrame, KeyFrames, PriorError, PriorId, RenderOptions, Splats};
use super::divide::{divide, longest_log_scale};
use super::head::{Block, Head, MAX_BLOCK, typical_edge};
use crate::coder_tables::Tables;
use crate::image::Preprocessing;
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

/// What a blocked prior holds besides splats.
#[derive(Clone, Copy, Debug)]
pub struct Extras<'a> {
    /// Where to look for a lost camera; possibly none.
    pub key_frames: &'a KeyFrames,
    /// The scene's own coder tables.
    pub coder_tables: Option<&'a Tables>,
    /// How the pictures that it was trained on were treated.
    pub preprocessing: &'a Preprocessing,
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
    /// Writes a prior. Takes host memory for the splats three times. `done` is called with the number of splats written,
    /// after each block.
    ///
    /// # Errors
    /// If the quantisation or the size of blocks is out of its range, if there is no splat, if one is invalid or one of
    /// its values too large for its step, or if `writer` fails.
    pub fn write(
        &self,
        splats: &Splats,
        options: &RenderOptions,
        extras: &Extras,
        mut writer: impl Write,
        done: &mut dyn FnMut(usize),
    ) -> Result<BlockedSummary, PriorError> {
        splats.check_shape()?;
        if splats.is_empty() {
            return Err(PriorError::Empty);
        }
        if self.block == 0 || self.block > MAX_BLOCK {
            return Err(PriorError::BlockSize { size: self.block, most: MAX_BLOCK });
        }
        let sh_degree = splats.needed_sh_degree();
        let visible = |i: &u32| splats.opacity(*i as usize) as f32 >= ALPHA_MIN;
        let mut shown: Vec<u32> = (0..splats.len() as u32).filter(visible).collect();
        if shown.is_empty() {
            // A blocked prior has one splat at least; this one shows nothing.
            shown.push(0);
        }
        let position = (NARROWER * self.quantisation.position).min(1.0);
        let quantisation = Quantisation { position, ..self.quantisation };
        let unseen = splats.len() - shown.len();
        let (mut coded, mut kept) = (Vec::new(), Splats { sh_degree, ..Splats::default() });
        let mut blocks = Vec::new();
        for which in divide(splats, shown, self.block) {
            let own = splats.picked(&which, sh_degree);
            let first = coded.len();
            let none = KeyFrames::NONE;
            compact::write(&own, options, &none, &quantisation, &mut coded)?;
            let mut own = compact::read(&coded[first..])?.splats;
            blocks.push(Block::of(&own, (coded.len() - first) as u32));
            kept.append(&mut own);
            done(kept.len());
        }
        let frame = frame_of(&kept, &blocks);
        let head = Head {
            sh_degree,
            options: *options,
            clamps_alpha: (0..kept.len()).any(|index| is_clamped(&kept, index, options)),
            splats: kept.len(),
            id: identity_of(&kept, options, extras.coder_tables, Some(&frame)),
            frame,
            radius: frame.radius_of(&kept.positions),
            blocks,
            besides: Besides {
                preprocessing: *extras.preprocessing,
                key_frames: extras.key_frames.clone(),
                coder_tables: extras.coder_tables.cloned(),
            },
        };
        let first = head.to_bytes();
        let written = writer.write_all(&first).and_then(|()| writer.write_all(&coded));
        written.and_then(|()| writer.flush()).map_err(PriorError::Write)?;
        Ok(BlockedSummary {
            id: head.id,
            splats: head.splats,
            unseen,
            blocks: head.blocks.len(),
            bytes: (first.len() + coded.len()) as u64,
        })
    }
}

/// Steps of a camera's centre in a compact packet, of 24 bits, reach so many units of the coordinate frame.
const REACH: f64 = 64.0;
/// Share of the splats that lie where cameras go. The others are strays.
const NEARLY_ALL: f64 = 0.98;

/// The frame in which packets state cameras. Its unit would grow with a site that is much larger than what a camera sees,
/// and the steps of poses with it. So it is that of a block, unless the steps then do not reach across the site.
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
    /// The block of these splats, of which there is at least one, in so many bytes. Its place in the file is open.
    fn of(splats: &Splats, bytes: u32) -> Block {
        let (mut least, mut greatest) = (splats.positions[0], splats.positions[0]);
        for position in &splats.positions {
            for axis in 0..3 {
                least[axis] = least[axis].min(position[axis]);
                greatest[axis] = greatest[axis].max(position[axis]);
            }
        }
        let count = splats.len() as u32;
        Block { splats: count, least, greatest, longest: longest(splats), bytes, offset: 0 }
    }
}
