//! The window on a blocked prior: the splats of those blocks that cameras see, as the device holds them.
//!
//! They lie in the planes in the order of the prior, one block behind the other, so that equal depths are in the order
//! that they have if all blocks are there. What is not there shows nothing. So a picture has the same bytes.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use glam::DVec3;

use crate::prior::analysis::splat_bytes;
use crate::prior::blocked::{Block, BlockedPrior};
use crate::shared::{GEOMETRY_PLANES, RECORD, sh_planes};
use crate::vulkan::{Buffer, Device, Error, Memory, Part, Recorder, Timing};

use super::block_cache::{BlockCache, BlockPlanes, BlockReader};
use super::sight::{Reach, Sight};
use super::splat_buffers::SplatBuffers;

/// Device memory that a renderer takes per splat, bytes: record, keys, order, and what is half sorted.
const PER_RENDERER: u64 = 16 * RECORD as u64 + 24;

/// Splats that are copied to the device at once.
const COPIED: usize = 1 << 15;

/// How many splats of a blocked prior there is room for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct WindowRoom {
    /// On the device.
    pub device: usize,
    /// In host memory.
    pub host: usize,
}

impl WindowRoom {
    /// The room that `limit` bytes give a blocked prior, its host memory and one renderer's included.
    pub fn within(blocked: &BlockedPrior, limit: u64, storage_range: u64) -> WindowRoom {
        let planes = GEOMETRY_PLANES.max(sh_planes(blocked.sh_degree()));
        let own = splat_bytes(blocked.sh_degree());
        // Host memory holds half as many again as the device: what is expected next.
        let each = own + own * 3 / 2 + PER_RENDERER;
        let by_limit = limit / each;
        let by_range = storage_range / (8 * u64::from(planes)).max(16 * u64::from(RECORD)) - 1;
        let device = by_limit.min(by_range).min(blocked.len() as u64).max(1) as usize;
        let host = (by_limit + by_limit / 2).min(blocked.len() as u64).max(1) as usize;
        WindowRoom { device, host }
    }
}

/// What a window did so far, and holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Residency {
    /// Blocks on the device.
    pub blocks: usize,
    /// Splats on the device.
    pub splats: usize,
    /// Splats that there is room for on the device.
    pub room: usize,
    /// Bytes of splats in host memory.
    pub host_bytes: u64,
    /// How often the blocks on the device changed.
    pub changes: u64,
    /// Blocks that a frame waited for: they were not read ahead.
    pub waits: u64,
    /// Searches that were done again, since evaluations went further than blocks had been brought. They are not in the
    /// counts of renders.
    pub repeated: u64,
    /// Searches in which evaluations lacked blocks, since there was no room for all.
    pub incomplete: u64,
}

/// The blocks of a blocked prior that the device holds, and how they get there.
pub(crate) struct Window {
    blocked: Arc<BlockedPrior>,
    cache: BlockCache,
    device: Device,
    room: usize,
    /// The median of the longest sides of the blocks' boxes, the prior's unit.
    edge: f64,
    content: Mutex<Content>,
    ahead: Mutex<Ahead>,
}

/// Blocks that are to be read ahead.
struct Ahead {
    blocks: Vec<u32>,
    /// The same, by block.
    named: Vec<bool>,
}

/// What the planes hold.
pub(crate) struct Content {
    /// Blocks, in the order of the prior.
    listed: Vec<u32>,
    /// The same, by block.
    is_listed: Vec<bool>,
    staged: [Buffer; 2],
    /// Room and counts; the rest follows from what is there.
    residency: Residency,
}

impl Window {
    /// An empty window.
    pub fn new(
        device: &Device,
        blocked: &Arc<BlockedPrior>,
        room: &WindowRoom,
        reader: BlockReader,
    ) -> Result<Window, Error> {
        let centre = DVec3::from(blocked.coordinate_frame().centre.map(f64::from));
        let (count, copied) = (blocked.blocks().len(), COPIED.min(room.device));
        let staged = |name, planes: u32| {
            Buffer::new::<[f32; 2]>(device, name, planes as usize * copied, Memory::Upload)
        };
        let content = Content {
            listed: Vec::with_capacity(count),
            is_listed: vec![false; count],
            staged: [
                staged("geometry on its way", GEOMETRY_PLANES)?,
                staged("spherical harmonics on their way", sh_planes(blocked.sh_degree()))?,
            ],
            residency: Residency { room: room.device, ..Residency::default() },
        };
        Ok(Window {
            cache: BlockCache::new(blocked.clone(), centre, room.host, reader),
            blocked: blocked.clone(),
            device: device.clone(),
            room: room.device,
            edge: blocked.typical_edge(),
            content: Mutex::new(content),
            ahead: Mutex::new(Ahead {
                blocks: Vec::with_capacity(count),
                named: vec![false; count],
            }),
        })
    }

    fn content(&self) -> MutexGuard<'_, Content> {
        self.content.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// How far a search is expected to go from its start.
    pub fn searched(&self) -> Reach {
        Reach { moved: 0.1 * self.edge, turned: 0.05 }
    }

    /// How far around a pose blocks are brought along with those that it needs, so that they change seldom.
    pub fn wanted(&self) -> Reach {
        self.searched().times(3.0)
    }

    /// Whether all blocks that `needed` names are there.
    pub fn has(&self, needed: impl Fn(&Block) -> bool) -> bool {
        let content = self.content();
        let blocks = self.blocked.blocks().iter().zip(&content.is_listed);
        blocks.into_iter().all(|(block, there)| *there || !needed(block))
    }

    /// Brings all blocks that `needed` names to the device, if they are not there, and with them those that `wanted`
    /// names, if there is room. As long as the guard is held, they stay.
    ///
    /// # Errors
    /// If there is no room for those that are needed: then nothing changes. If a block cannot be read: then the blocks
    /// that would have stayed in place are there.
    pub fn see(
        &self,
        splats: &SplatBuffers,
        needed: impl Fn(&Block) -> bool,
        wanted: impl Fn(&Block) -> bool,
    ) -> Result<MutexGuard<'_, Content>, Error> {
        let mut content = self.content();
        let blocks = || self.blocked.blocks().iter().zip(0..);
        if blocks().all(|(block, i)| content.is_listed[i as usize] || !needed(block)) {
            return Ok(content);
        }
        let list = |which: &dyn Fn(&Block) -> bool| -> Vec<u32> {
            blocks().filter(|(block, _)| which(block)).map(|(_, i)| i).collect()
        };
        let mut next = list(&|block| needed(block) || wanted(block));
        if self.splats_of(&next) > self.room {
            next = list(&needed);
        }
        let (needed, room) = (self.splats_of(&next), self.room);
        if needed > room {
            return Err(Error::TooManySplats { needed: needed as u64, room: room as u64 });
        }
        self.bring(&mut content, splats, next)?;
        Ok(content)
    }

    /// Has the blocks that some sights may show read ahead, those of the first sight first.
    pub fn expect(&self, sights: &[Sight]) {
        let mut ahead = self.ahead.lock().unwrap_or_else(PoisonError::into_inner);
        let Ahead { blocks, named } = &mut *ahead;
        blocks.clear();
        named.fill(false);
        for sight in sights {
            for (block, index) in self.blocked.blocks().iter().zip(0..) {
                if !named[index as usize] && sight.may_show(block) {
                    named[index as usize] = true;
                    blocks.push(index);
                }
            }
        }
        self.cache.expect(blocks);
    }

    /// Puts a list of blocks in the place of those that are there.
    fn bring(
        &self,
        content: &mut Content,
        splats: &SplatBuffers,
        next: Vec<u32>,
    ) -> Result<(), Error> {
        let unread = |error| Error::Unread(Box::new(error));
        let same = next.iter().zip(&content.listed).take_while(|(a, b)| a == b).count();
        let mut at = self.splats_of(&next[..same]);
        // What follows may fail midway: then only what stays in place is there.
        content.keep(same);
        splats.hold(at as u32, self.blocked.radius());
        let mut batch = Vec::new();
        let mut batched = 0;
        for index in &next[same..] {
            let (planes, waited) = self.cache.get(*index).map_err(unread)?;
            content.residency.waits += u64::from(waited);
            if batched + planes.splats > COPIED.min(self.room) {
                self.copy(content, splats, &batch, at)?;
                at += batched;
                (batch, batched) = (Vec::new(), 0);
            }
            batched += planes.splats;
            batch.push(planes);
        }
        self.copy(content, splats, &batch, at)?;
        at += batched;
        for index in &next[same..] {
            content.is_listed[*index as usize] = true;
        }
        content.listed = next;
        content.residency.changes += 1;
        splats.hold(at as u32, self.blocked.radius());
        Ok(())
    }

    /// Copies the planes of some blocks to the device, from splat `at` on.
    fn copy(
        &self,
        content: &mut Content,
        splats: &SplatBuffers,
        batch: &[Arc<BlockPlanes>],
        at: usize,
    ) -> Result<(), Error> {
        let count: usize = batch.iter().map(|planes| planes.splats).sum();
        if count == 0 {
            return Ok(());
        }
        let degree = self.blocked.sh_degree();
        let mut recorder = Recorder::new(&self.device, Timing::None)?;
        let [geometry, sh] = &mut content.staged;
        stage(geometry, GEOMETRY_PLANES, count, batch, |planes| &planes.geometry);
        stage(sh, sh_planes(degree), count, batch, |planes| &planes.sh);
        let parts = |planes: u32| -> Vec<Part> {
            let words = 2 * count as u64;
            let to = |plane| 2 * (plane * u64::from(splats.room) + at as u64);
            (0..u64::from(planes)).map(|p| Part { from: p * words, to: to(p), words }).collect()
        };
        recorder.copy_parts(geometry, &splats.geometry, &parts(GEOMETRY_PLANES));
        recorder.copy_parts(sh, &splats.sh, &parts(sh_planes(degree)));
        recorder.barrier("blocks");
        recorder.finish()?.run()
    }

    /// What it did and holds.
    pub fn residency(&self) -> Residency {
        let content = self.content();
        let host = self.cache.splats() as u64;
        Residency {
            blocks: content.listed.len(),
            splats: self.splats_of(&content.listed),
            host_bytes: host * splat_bytes(self.blocked.sh_degree()),
            ..content.residency
        }
    }

    /// Splats of some blocks.
    fn splats_of(&self, list: &[u32]) -> usize {
        list.iter().map(|index| self.blocked.blocks()[*index as usize].splats as usize).sum()
    }

    /// Notes that a search is done again, with more blocks.
    pub fn note_repeated(&self) {
        self.content().residency.repeated += 1;
    }

    /// Notes a search that lacked blocks.
    pub fn note_incomplete(&self) {
        self.content().residency.incomplete += 1;
    }
}

impl Content {
    /// Forgets all blocks but the first ones.
    fn keep(&mut self, count: usize) {
        for index in self.listed.drain(count..) {
            self.is_listed[index as usize] = false;
        }
    }
}

/// Writes a kind of planes of some blocks, so that each plane holds all of them.
fn stage(
    to: &mut Buffer,
    planes: u32,
    count: usize,
    batch: &[Arc<BlockPlanes>],
    of: impl Fn(&BlockPlanes) -> &Vec<f32>,
) {
    let mut at = 0;
    for block in batch {
        let words = 2 * block.splats;
        for (plane, own) in of(block).chunks_exact(words).take(planes as usize).enumerate() {
            to.write_at(2 * (plane * count + at), own);
        }
        at += block.splats;
    }
}
