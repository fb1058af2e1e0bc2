//! Writing a site.

use std::io::Write;

use super::super::analysis;
use super::super::compact::{self, Besides, Quantisation};
use super::super::identity::identity_of;
use super::super::{CoordinateFrame, KeyFrames, Prior, PriorError, PriorId, RenderOptions, Splats};
use super::divide::{divide, longest_log_scale};
use super::head::{Block, Head, MAX_BLOCK};
use crate::coder_tables::Tables;
use crate::shared::ALPHA_MIN;

/// How a site is written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SiteWriter {
    /// How coarsely. Steps of positions are shares of a block's spread.
    pub quantisation: Quantisation,
    /// Most splats of a block, at least 1, at most [`MAX_BLOCK`].
    pub block: usize,
}

impl Default for SiteWriter {
    fn default() -> SiteWriter {
        // A block of this size is about a third as wide as the priors that the default step was chosen for.
        let quantisation = Quantisation { position: 1.0 / 1024.0, ..Quantisation::default() };
        SiteWriter { quantisation, block: 4096 }
    }
}

/// What was written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SiteSummary {
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

impl SiteWriter {
    /// Writes a prior's splats, key frames, coder tables and preprocessing. Takes host memory for the splats three times.
    /// `done` is called with the number of splats written, after each block.
    ///
    /// # Errors
    /// If the quantisation or the size of blocks is out of its range, if a value is too large for its step, or if
    /// `writer` fails.
    pub fn write(
        &self,
        prior: &Prior,
        mut writer: impl Write,
        done: &mut dyn FnMut(usize),
    ) -> Result<SiteSummary, PriorError> {
        let (splats, options) = (prior.splats(), prior.options());
        if self.block == 0 || self.block > MAX_BLOCK {
            return Err(PriorError::BlockSize { size: self.block, most: MAX_BLOCK });
        }
        let sh_degree = analysis::sh_degree(splats);
        let visible = |i: &u32| splats.opacity(*i as usize) as f32 >= ALPHA_MIN;
        let mut shown: Vec<u32> = (0..splats.len() as u32).filter(visible).collect();
        if shown.is_empty() {
            // A site has one splat at least; this one shows nothing.
            shown.push(0);
        }
        let unseen = splats.len() - shown.len();
        let (mut coded, mut kept) = (Vec::new(), Splats { sh_degree, ..Splats::default() });
        let mut blocks = Vec::new();
        for which in divide(splats, shown, self.block) {
            let own = splats.picked(&which, sh_degree);
            let first = coded.len();
            let none = KeyFrames::NONE;
            compact::write(&own, options, &none, &self.quantisation, &mut coded)?;
            let mut own = compact::read(&coded[first..])?.splats;
            blocks.push(Block::of(&own, (coded.len() - first) as u32));
            kept.append(&mut own);
            done(kept.len());
        }
        let tables = prior.coder_tables().map(|tables| Tables::clone(tables));
        let frame = CoordinateFrame::of(&kept.positions);
        let head = Head {
            sh_degree,
            options: *options,
            clamps_alpha: (0..kept.len()).any(|index| is_clamped(&kept, index, options)),
            splats: kept.len(),
            id: identity_of(&kept, options, tables.as_ref()),
            frame,
            radius: frame.radius_of(&kept.positions),
            blocks,
            besides: Besides {
                preprocessing: *prior.preprocessing(),
                key_frames: prior.key_frames().clone(),
                coder_tables: tables,
            },
        };
        let first = head.to_bytes();
        let written = writer.write_all(&first).and_then(|()| writer.write_all(&coded));
        written.and_then(|()| writer.flush()).map_err(PriorError::Write)?;
        Ok(SiteSummary {
            id: head.id,
            splats: head.splats,
            unseen,
            blocks: head.blocks.len(),
            bytes: (first.len() + coded.len()) as u64,
        })
    }
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
