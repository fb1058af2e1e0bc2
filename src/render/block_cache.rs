//! Blocks of a blocked prior in host memory, laid out for the device. A thread reads those that are expected next.

use std::any::Any;
use std::collections::{HashMap, VecDeque};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

use glam::DVec3;

use crate::prior::blocked::BlockedPrior;
use crate::prior::{PriorClaims, PriorError};
use crate::queue::Body;

use super::splat_buffers;

/// The splats of a block, in planes with room for just them.
pub(super) struct BlockPlanes {
    pub splats: usize,
    pub geometry: Vec<f32>,
    pub sh: Vec<f32>,
}

/// Starts a thread that runs a body. What it returns waits for the thread's end when dropped; `None`: no thread can be
/// started, so blocks are read when they are needed.
pub type SpawnReader = Box<dyn FnOnce(Body) -> Option<Box<dyn Send + Sync>>>;

/// Sets so many bytes aside, as long as what it returns lives; `None`: there is not so much memory.
pub type SetAside = Box<dyn Fn(u64) -> Option<Box<dyn Any>> + Send + Sync>;

/// How blocks are read.
pub struct BlockReader {
    /// Starts the thread that reads ahead.
    pub spawn: SpawnReader,
    /// Sets memory aside for a block that is read.
    pub set_aside: SetAside,
}

impl BlockReader {
    /// Reads ahead on a thread of the standard library.
    pub fn threaded() -> BlockReader {
        struct Joined(Option<JoinHandle<()>>);
        impl Drop for Joined {
            fn drop(&mut self) {
                // The body does not panic.
                let _ = self.0.take().map(JoinHandle::join);
            }
        }
        let spawn: SpawnReader = Box::new(|body| {
            let thread = std::thread::Builder::new().name("nvsp-blocks".into()).spawn(body);
            thread.ok().map(|thread| -> Box<dyn Send + Sync> { Box::new(Joined(Some(thread))) })
        });
        BlockReader { spawn, ..BlockReader::when_needed() }
    }

    /// Reads blocks when they are needed, on the thread that needs them.
    pub fn when_needed() -> BlockReader {
        BlockReader { spawn: Box::new(|_| None), set_aside: Box::new(|_| Some(Box::new(()))) }
    }
}

/// Blocks in host memory, at most so many splats, and the thread that reads ahead.
pub(super) struct BlockCache {
    shared: Arc<Shared>,
    /// Ends after `shared` tells it to.
    thread: Option<Box<dyn Send + Sync>>,
}

struct Shared {
    blocked: Arc<BlockedPrior>,
    /// What positions on the device are relative to.
    centre: DVec3,
    /// Splats that there is room for.
    room: usize,
    set_aside: SetAside,
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Default)]
struct State {
    held: HashMap<u32, CachedBlock>,
    /// Splats of them.
    splats: usize,
    /// Counts uses.
    clock: u64,
    expected: VecDeque<u32>,
    /// The block that the thread reads.
    reading: Option<u32>,
    quit: bool,
}

struct CachedBlock {
    planes: Arc<BlockPlanes>,
    last_use: u64,
}

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        // No code that could panic runs under this lock.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn read(&self, index: u32) -> Result<Arc<BlockPlanes>, PriorError> {
        let claims =
            PriorClaims::of_block(&self.blocked.blocks()[index as usize], self.blocked.sh_degree());
        // The bytes of the file, what becomes of them, and what is laid out for the device.
        let needed = claims.bytes + claims.host_bytes() + claims.device_bytes();
        let out_of_memory = || PriorError::Read(std::io::ErrorKind::OutOfMemory.into());
        let _memory = (self.set_aside)(needed).ok_or_else(out_of_memory)?;
        let splats = self.blocked.read_block(index as usize)?;
        let which: Vec<u32> = (0..splats.len() as u32).collect();
        let count = which.len();
        Ok(Arc::new(BlockPlanes {
            splats: count,
            geometry: splat_buffers::geometry(&splats, &which, count, self.centre),
            sh: splat_buffers::sh_planes(&splats, &which, count, splats.sh_degree),
        }))
    }

    /// What the thread does.
    fn read_ahead(&self) {
        loop {
            let rest = |state: &mut State| state.expected.is_empty() && !state.quit;
            let state = self.changed.wait_while(self.state(), rest);
            let mut state = state.unwrap_or_else(PoisonError::into_inner);
            if state.quit {
                return;
            }
            let Some(index) = state.expected.pop_front() else { continue };
            if state.held.contains_key(&index) {
                continue;
            }
            state.reading = Some(index);
            drop(state);
            let read = self.read(index);
            let mut state = self.state();
            state.reading = None;
            // A block that cannot be read is read again by who needs it, and its error told.
            if let Ok(planes) = read {
                state.add(index, planes, self.room);
            }
            self.changed.notify_all();
        }
    }
}

impl State {
    fn use_of(&mut self, index: u32) -> Option<Arc<BlockPlanes>> {
        self.clock += 1;
        let held = self.held.get_mut(&index)?;
        held.last_use = self.clock;
        Some(held.planes.clone())
    }

    /// Adds a block. Those that were not used for longest go, if there is no room.
    fn add(&mut self, index: u32, planes: Arc<BlockPlanes>, room: usize) {
        self.clock += 1;
        while self.splats + planes.splats > room {
            let oldest = self.held.iter().min_by_key(|(_, held)| held.last_use);
            let Some(oldest) = oldest.map(|(index, _)| *index) else { break };
            self.drop_block(oldest);
        }
        self.drop_block(index);
        self.splats += planes.splats;
        self.held.insert(index, CachedBlock { planes, last_use: self.clock });
    }

    fn drop_block(&mut self, index: u32) {
        if let Some(held) = self.held.remove(&index) {
            self.splats -= held.planes.splats;
        }
    }
}

impl BlockCache {
    /// An empty cache with room for so many splats.
    pub fn new(
        blocked: Arc<BlockedPrior>,
        centre: DVec3,
        room: usize,
        reader: BlockReader,
    ) -> BlockCache {
        let count = blocked.blocks().len();
        let (held, expected) = (HashMap::with_capacity(count), VecDeque::with_capacity(count));
        let state = Mutex::new(State { held, expected, ..State::default() });
        let BlockReader { spawn, set_aside } = reader;
        let changed = Condvar::new();
        let shared = Arc::new(Shared { blocked, centre, room, set_aside, state, changed });
        let own = shared.clone();
        // Without a thread, blocks are read when they are needed.
        let thread = spawn(Box::new(move || own.read_ahead()));
        BlockCache { shared, thread }
    }

    /// The planes of a block, and whether it had to be read, or waited for.
    pub fn get(&self, index: u32) -> Result<(Arc<BlockPlanes>, bool), PriorError> {
        let Shared { changed, .. } = &*self.shared;
        let mut state = self.shared.state();
        let mut waited = false;
        loop {
            if let Some(planes) = state.use_of(index) {
                return Ok((planes, waited));
            }
            if state.reading != Some(index) {
                break;
            }
            waited = true;
            state = changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        drop(state);
        let planes = self.shared.read(index)?;
        self.shared.state().add(index, planes.clone(), self.shared.room);
        Ok((planes, true))
    }

    /// Has the thread read these blocks, each named once, in this order, in place of those that it was to read.
    pub fn expect(&self, blocks: &[u32]) {
        if self.thread.is_none() {
            return;
        }
        let mut state = self.shared.state();
        state.expected.clear();
        let mut room = self.shared.room;
        for &index in blocks {
            // More than there is room for would drive itself out.
            let splats = self.shared.blocked.blocks()[index as usize].splats as usize;
            if splats > room {
                break;
            }
            room -= splats;
            if state.use_of(index).is_none() {
                state.expected.push_back(index);
            }
        }
        self.shared.changed.notify_all();
    }

    /// Splats that it holds.
    pub fn splats(&self) -> usize {
        self.shared.state().splats
    }
}

impl Drop for BlockCache {
    fn drop(&mut self) {
        self.shared.state().quit = true;
        self.shared.changed.notify_all();
        // Waits for its end.
        self.thread = None;
    }
}
