//! A blocked prior, `.nvsb`: a prior in blocks, for scenes that do not fit into the memory of a vehicle.
//!
//! The bytes: `docs/format/prior.md`. Each block has at most [`MAX_BLOCK`] splats in steps. The head says
//! where each block lies in the file and in space, so that those that a camera can see are read without the others. A
//! blocked prior has the identity of a prior of all its splats, in the order of the file. So one side of a link may
//! hold it whole, and the other in blocks: their pictures have the same bytes.

mod divide;
mod head;
mod write;

use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use glam::DVec3;

use super::check::fault_of;
use super::compact::Coded;
use super::container::{Format, Head};
use super::error::PriorError;
use super::file_content::PriorFile;
use super::identity::identity_of;
use super::report::PriorFormat;
use super::splats::Splats;
use super::{CoordinateFrame, Extras, PriorId, RenderOptions};
use crate::coder_tables::Tables;
use head::BlockedHead;
pub use head::{Block, MAGIC, MAX_BLOCK};
pub use write::{BlockedSummary, BlockedWriter};

/// A blocked prior whose splats are read block by block. Its head is checked when it is opened, a block when it is
/// read.
#[derive(Debug)]
pub struct BlockedPrior {
    file: File,
    path: PathBuf,
    head: BlockedHead,
}

impl BlockedPrior {
    /// Opens a blocked prior and reads its head. The file must stay as it is, as long as it is open.
    pub fn open(path: &Path) -> Result<BlockedPrior, PriorError> {
        let read = || {
            let file = File::open(path).map_err(PriorError::Read)?;
            let size = file.metadata().map_err(PriorError::Read)?.len();
            let mut start = vec![0; size.min(Head::BYTES as u64) as usize];
            file.read_exact_at(&mut start, 0).map_err(PriorError::Read)?;
            let end = Head::read(&start, Format::Blocked, size)?.end;
            let mut parts = vec![0; end as usize];
            file.read_exact_at(&mut parts, 0).map_err(PriorError::Read)?;
            let head = BlockedHead::read(&parts, size)?;
            Ok(BlockedPrior { file, path: path.to_owned(), head })
        };
        read().map_err(|error: PriorError| error.in_file(&path.display().to_string()))
    }

    /// Whether the file at `path` begins as a blocked prior does.
    pub fn is_at(path: &Path) -> bool {
        let mut start = [0; MAGIC.len()];
        let read = File::open(path).and_then(|file| file.read_exact_at(&mut start, 0));
        read.is_ok() && start == MAGIC
    }

    /// Number of splats; never zero.
    #[allow(clippy::len_without_is_empty)] // A blocked prior is never empty.
    pub fn len(&self) -> usize {
        self.head.splats
    }

    /// Where its blocks lie in space, in the order of their splats.
    pub fn blocks(&self) -> &[Block] {
        &self.head.blocks
    }

    /// Identity of the prior of all its splats.
    pub fn id(&self) -> PriorId {
        self.head.id
    }

    /// Degree of the spherical harmonics.
    pub fn sh_degree(&self) -> u32 {
        self.head.sh_degree
    }

    /// How to render it.
    pub fn options(&self) -> &RenderOptions {
        &self.head.options
    }

    /// Whether a splat's alpha may exceed the clamp.
    pub fn clamps_alpha(&self) -> bool {
        self.head.clamps_alpha
    }

    /// The frame in which packets state camera positions.
    pub fn coordinate_frame(&self) -> CoordinateFrame {
        self.head.frame
    }

    /// As [`Prior::origin`](super::Prior::origin).
    pub fn origin(&self) -> DVec3 {
        self.head.origin.into()
    }

    /// The median, over blocks, of the longest side of their boxes, the prior's unit.
    pub fn typical_edge(&self) -> f64 {
        head::typical_edge(&self.head.blocks)
    }

    /// No splat's middle is further than this from the centre of the coordinate frame.
    pub fn radius(&self) -> f32 {
        self.head.radius
    }

    /// The scene coder tables; `None`: the generic tables are used.
    pub fn coder_tables(&self) -> Option<&Tables> {
        self.head.coder_tables.as_ref()
    }

    /// What it holds that changes no picture.
    pub fn extras(&self) -> &Extras {
        &self.head.extras
    }

    /// Reads and checks the splats of a block. Takes memory by the size of the block. Any thread may call it.
    ///
    /// # Panics
    /// If there is no such block.
    pub fn read_block(&self, index: usize) -> Result<Splats, PriorError> {
        let block = &self.head.blocks[index];
        let mut bytes = vec![0; block.bytes as usize];
        let read = self.file.read_exact_at(&mut bytes, block.offset).map_err(PriorError::Read);
        read.and_then(|()| self.head.splats_of(index, &bytes))
            .map_err(|error| error.in_file(&self.path.display().to_string()))
    }
}

/// Reads a blocked prior whole. Memory depends on the content's size, as for a compact prior.
pub(super) fn read(bytes: &[u8]) -> Result<PriorFile, PriorError> {
    let head = BlockedHead::read(bytes, bytes.len() as u64)?;
    let (sh_degree, origin) = (head.sh_degree, head.origin);
    let mut splats = Splats { sh_degree, origin, ..Splats::default() };
    for (index, block) in head.blocks.iter().enumerate() {
        let own = &bytes[block.offset as usize..][..block.bytes as usize];
        splats.append(&mut head.splats_of(index, own)?);
    }
    let tables = head.coder_tables.as_ref();
    let found = identity_of(&splats, &head.options, Some(&head.frame), tables);
    if found != head.id {
        return Err(PriorError::Identity { stated: head.id, found });
    }
    Ok(PriorFile {
        coder_tables: head.coder_tables,
        frame: Some(head.frame),
        extras: head.extras,
        ..PriorFile::new(splats, head.options, PriorFormat::Blocked)
    })
}

impl BlockedHead {
    /// The splats of a block, from its bytes. Checks all that pictures by blocks rely on.
    fn splats_of(&self, index: usize, bytes: &[u8]) -> Result<Splats, PriorError> {
        let block = &self.blocks[index];
        let read = || {
            let (stated, found) = (block.check, crc32fast::hash(bytes));
            if stated != found {
                return Err(PriorError::Damaged { stated, found });
            }
            let (at, count) = (block.offset as usize, block.splats as usize);
            let splats = Coded::read(bytes, at, count, self.sh_degree)?.splats();
            let splats = Splats { origin: self.origin, ..splats };
            match self.lies(block, &splats) {
                Some(reason) => Err(head::refusal(at, reason.into())),
                None => Ok(splats),
            }
        };
        read().map_err(|error| PriorError::InBlock { block: index, error: Box::new(error) })
    }

    /// What the head says of a block's splats, and is not true.
    fn lies(&self, block: &Block, splats: &Splats) -> Option<&'static str> {
        let inside = |p: &[f32; 3]| {
            (0..3).all(|axis| p[axis] >= block.least[axis] && p[axis] <= block.greatest[axis])
        };
        let valid = |index| fault_of(splats, index).is_none();
        let faint = |index| !self.clamps_alpha && write::is_clamped(splats, index, &self.options);
        match () {
            _ if !(0..splats.len()).all(valid) => Some("a splat is not valid"),
            _ if !splats.positions.iter().all(inside) => Some("a splat lies outside of its box"),
            _ if write::longest(splats) > block.longest => Some("a splat is longer than stated"),
            _ if self.frame.radius_of(&splats.positions) > self.radius => {
                Some("a splat lies beyond the stated radius")
            }
            _ if (0..splats.len()).any(faint) => Some("a splat is more opaque than stated"),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests;
