//! Work beside the caller: frames go through workers, each on a thread of its own.
//!
//! A queue has a fixed number of *slots*, each with the buffers of one frame, and one worker or two. A frame is begun
//! by filling a spare slot. It then goes from worker to worker and waits until its result is taken. Frames never
//! overtake each other. Rules:
//!
//! - A frame that was begun is the caller's until [`take`](Queue::take) or [`cancel`](Queue::cancel) ends it. No other
//!   call drops it.
//! - If a result cannot be handed over, it is *kept*: the next [`run`](Queue::run) drops it, and in a queue of one slot
//!   the next [`begin`](Queue::begin) too.
//! - A frame that is cancelled while a worker works on it ends by itself. Until then no frame can be begun.
//! - If a frame is dropped, what it told is lost: the queue notes that in its [`Lost`]. A worker does so for a frame
//!   that it fails.
//! - A worker that panics poisons the queue.

use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Duration;

/// Why a queue refuses a call.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs)] // Their texts tell.
pub enum QueueError {
    #[error("all frames that may be under way are: finish the first, or cancel them")]
    Full,
    #[error("a frame that was cancelled has not ended yet")]
    Ending,
    #[error("a frame is under way: finish it or cancel it")]
    UnderWay,
    #[error("nothing was begun")]
    Empty,
    #[error("a fault of the library itself: please report it")]
    Panicked,
    #[error("an earlier frame failed inside the library")]
    Poisoned,
}

/// What a worker does to a slot.
pub type Worker<S, E> = Box<dyn FnMut(&mut S) -> Result<(), E> + Send>;

/// What a thread of the queue does. It does not unwind.
pub type Body = Box<dyn FnOnce() + Send>;

/// Starts the thread of the worker of a number. What it returns waits for the thread's end when dropped.
pub type Spawn<E> = Box<dyn FnMut(usize, Body) -> Result<Box<dyn Send>, E> + Send>;

/// Whether frames were lost that told something. A queue, its workers and its owner share it.
#[derive(Clone, Default)]
pub struct Lost(Arc<AtomicBool>);

impl Lost {
    pub fn note(&self, lost: bool) {
        self.0.fetch_or(lost, Ordering::Relaxed);
    }

    /// Whether any was noted since the last call. Who sees that to be true tells it again.
    pub fn take(&self) -> bool {
        self.0.swap(false, Ordering::Relaxed)
    }
}

/// Ends work that is under way, from any thread. All who hold it share it.
#[derive(Clone, Default)]
pub struct Interrupt(Arc<Asked>);

#[derive(Default)]
struct Asked {
    is_set: AtomicBool,
    look: OnceLock<Box<dyn Fn() -> bool + Send + Sync>>,
}

impl Interrupt {
    /// Has the work end.
    pub fn set(&self) {
        self.0.is_set.store(true, Ordering::Relaxed);
    }

    /// Lets work go on from here.
    pub fn clear(&self) {
        self.0.is_set.store(false, Ordering::Relaxed);
    }

    /// Has work ask, too, before each submission, whether to end: the first one who says what to ask.
    pub fn ask(&self, look: impl Fn() -> bool + Send + Sync + 'static) {
        self.0.look.get_or_init(|| Box::new(look));
    }

    pub fn is_set(&self) -> bool {
        self.0.is_set.load(Ordering::Relaxed) || self.0.look.get().is_some_and(|look| look())
    }
}

/// A frame on its way.
struct Slot<S, E> {
    content: S,
    outcome: Result<(), E>,
    /// [`State::cancels`] when it was begun.
    begun_at: u64,
    /// The result could not be handed over.
    kept: bool,
}

type Slots<S, E> = VecDeque<Box<Slot<S, E>>>;

/// A slot goes from `spare` through `waiting` for each worker to `done`, and back.
struct State<S, E> {
    spare: Slots<S, E>,
    /// By worker.
    waiting: Vec<Slots<S, E>>,
    /// Whether a worker works on a slot.
    busy: Vec<bool>,
    done: Slots<S, E>,
    slots: usize,
    /// Frames that were begun and neither taken nor cancelled.
    live: usize,
    /// How often all that was under way was cancelled.
    cancels: u64,
    lost: Lost,
    poisoned: bool,
    quit: bool,
}

struct Shared<S, E> {
    workers: Vec<Mutex<Worker<S, E>>>,
    state: Mutex<State<S, E>>,
    changed: Condvar,
}

/// Frames on their way through workers.
pub struct Queue<S, E> {
    shared: Arc<Shared<S, E>>,
    /// Started with the first frame that is begun.
    threads: Vec<Box<dyn Send>>,
    spawn: Spawn<E>,
}

impl<S, E> State<S, E> {
    fn under_way(&self) -> usize {
        self.slots - self.spare.len()
    }

    fn kept(&self) -> usize {
        self.done.iter().filter(|slot| slot.kept).count()
    }

    /// Ends frames that were done, and notes that they are lost.
    fn drop_done(&mut self, count: usize) {
        for slot in self.done.drain(..count) {
            self.lost.note(slot.outcome.is_ok());
            self.spare.push_back(slot);
            self.live -= 1;
        }
    }

    fn check(&self) -> Result<(), QueueError> {
        match self {
            _ if self.poisoned => Err(QueueError::Poisoned),
            _ if self.under_way() > self.live => Err(QueueError::Ending),
            _ => Ok(()),
        }
    }
}

impl<S, E: From<QueueError>> Shared<S, E> {
    fn state(&self) -> MutexGuard<'_, State<S, E>> {
        // No code that could panic runs under this lock.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for a slot of a worker; `None`: the thread is to end.
    fn next(&self, worker: usize) -> Option<Box<Slot<S, E>>> {
        let rest = |state: &mut State<S, E>| state.waiting[worker].is_empty() && !state.quit;
        let state = self.changed.wait_while(self.state(), rest);
        let mut state = state.unwrap_or_else(PoisonError::into_inner);
        if state.quit {
            return None;
        }
        state.busy[worker] = true;
        state.waiting[worker].pop_front()
    }

    /// Passes a slot on from a worker, unless it was cancelled meanwhile.
    fn pass(&self, slot: Box<Slot<S, E>>, worker: usize) {
        let mut state = self.state();
        state.busy[worker] = false;
        if slot.begun_at != state.cancels {
            state.lost.note(true);
            state.spare.push_back(slot);
        } else if worker + 1 < self.workers.len() {
            state.waiting[worker + 1].push_back(slot);
        } else {
            state.done.push_back(slot);
        }
        self.changed.notify_all();
    }

    /// Does a worker's work on a slot, unless an earlier worker failed. A panic poisons the queue.
    fn work(&self, slot: &mut Slot<S, E>, worker: usize) {
        let work = || {
            let mut work = self.workers[worker].lock().map_err(|_| QueueError::Poisoned)?;
            work(&mut slot.content)
        };
        if slot.outcome.is_ok() {
            slot.outcome = catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|_| {
                self.state().poisoned = true;
                Err(QueueError::Panicked.into())
            });
        }
    }

    /// The thread of a worker.
    fn serve(&self, worker: usize) {
        while let Some(mut slot) = self.next(worker) {
            self.work(&mut slot, worker);
            self.pass(slot, worker);
        }
    }
}

impl<S: Send + 'static, E: From<QueueError> + Send + 'static> Queue<S, E> {
    /// Makes a queue of these workers and slots. It notes dropped frames in `lost`.
    pub fn new(
        workers: Vec<Worker<S, E>>,
        slots: Vec<S>,
        lost: Lost,
        spawn: Spawn<E>,
    ) -> Queue<S, E> {
        let count = slots.len();
        let slot = |content| Box::new(Slot { content, outcome: Ok(()), begun_at: 0, kept: false });
        let room = || VecDeque::with_capacity(count);
        let state = State {
            spare: slots.into_iter().map(slot).collect(),
            waiting: workers.iter().map(|_| room()).collect(),
            busy: vec![false; workers.len()],
            done: room(),
            slots: count,
            live: 0,
            cancels: 0,
            lost,
            poisoned: false,
            quit: false,
        };
        let threads = Vec::with_capacity(workers.len());
        let workers = workers.into_iter().map(Mutex::new).collect();
        let shared = Shared { workers, state: Mutex::new(state), changed: Condvar::new() };
        Queue { shared: Arc::new(shared), threads, spawn }
    }

    /// Checks that no frame is under way, apart from results that are kept.
    pub fn check_idle(&self) -> Result<(), QueueError> {
        let state = self.shared.state();
        state.check()?;
        if state.under_way() > state.kept() { Err(QueueError::UnderWay) } else { Ok(()) }
    }

    /// Checks that the first worker works on no frame and that none waits for it.
    pub fn check_first_worker(&self) -> Result<(), QueueError> {
        let state = self.shared.state();
        if state.poisoned {
            return Err(QueueError::Poisoned);
        }
        let is_idle = !state.busy[0] && state.waiting[0].is_empty();
        if is_idle { Ok(()) } else { Err(QueueError::UnderWay) }
    }

    /// Begins a frame; `fill` fills its slot. If that fails, nothing changes.
    pub fn begin(&mut self, fill: impl FnOnce(&mut S) -> Result<(), E>) -> Result<(), E> {
        let one_slot = self.shared.state().slots == 1;
        let (mut slot, kept) = self.filled(one_slot, fill)?;
        if let Err(error) = self.start_threads() {
            self.put_back(slot, kept);
            return Err(error);
        }
        let mut state = self.shared.state();
        state.lost.note(kept && slot.outcome.is_ok());
        (slot.begun_at, slot.outcome, slot.kept) = (state.cancels, Ok(()), false);
        state.live += usize::from(!kept);
        state.waiting[0].push_back(slot);
        self.shared.changed.notify_all();
        Ok(())
    }

    /// Does a frame's work on this thread; its result is then done. Fails if another frame is under way.
    pub fn run(&mut self, fill: impl FnOnce(&mut S) -> Result<(), E>) -> Result<(), E> {
        self.check_idle()?;
        let (mut slot, kept) = self.filled(true, fill)?;
        {
            let mut state = self.shared.state();
            state.lost.note(kept && slot.outcome.is_ok());
            let others = state.kept();
            state.drop_done(others);
            (slot.begun_at, slot.outcome, slot.kept) = (state.cancels, Ok(()), true);
            state.live += usize::from(!kept);
        }
        for worker in 0..self.shared.workers.len() {
            self.shared.work(&mut slot, worker);
        }
        self.shared.state().done.push_back(slot);
        Ok(())
    }

    /// Takes a spare slot, or one whose result is kept if `may_drop` allows it, and fills it. Also returns whether its
    /// result was kept.
    #[allow(clippy::type_complexity)]
    fn filled(
        &self,
        may_drop: bool,
        fill: impl FnOnce(&mut S) -> Result<(), E>,
    ) -> Result<(Box<Slot<S, E>>, bool), E> {
        let (mut slot, kept) = {
            let mut state = self.shared.state();
            state.check()?;
            match state.spare.pop_front() {
                Some(slot) => (slot, false),
                None => {
                    let first = state.done.front().is_some_and(|slot| slot.kept && may_drop);
                    let kept = if first { state.done.pop_front() } else { None };
                    (kept.ok_or(QueueError::Full)?, true)
                }
            }
        };
        match fill(&mut slot.content) {
            Ok(()) => Ok((slot, kept)),
            Err(error) => {
                self.put_back(slot, kept);
                Err(error)
            }
        }
    }

    fn put_back(&self, slot: Box<Slot<S, E>>, kept: bool) {
        let mut state = self.shared.state();
        let to = if kept { &mut state.done } else { &mut state.spare };
        to.push_front(slot);
    }

    fn start_threads(&mut self) -> Result<(), E> {
        for worker in self.threads.len()..self.shared.workers.len() {
            let shared = self.shared.clone();
            self.threads.push((self.spawn)(worker, Box::new(move || shared.serve(worker)))?);
        }
        Ok(())
    }

    /// Waits for the end of the first frame under way, at most `timeout`. Returns whether it has ended.
    ///
    /// # Errors
    /// [`QueueError::Empty`] if none is under way.
    pub fn wait(&self, timeout: Duration) -> Result<bool, QueueError> {
        let pending = |state: &mut State<S, E>| state.done.is_empty() && state.under_way() > 0;
        let (state, _) = self
            .shared
            .changed
            .wait_timeout_while(self.shared.state(), timeout, pending)
            .unwrap_or_else(PoisonError::into_inner);
        match (state.done.is_empty(), state.under_way()) {
            (false, _) => Ok(true),
            (true, 0) => Err(QueueError::Empty),
            (true, _) => Ok(false),
        }
    }

    /// Takes the first frame, if it has ended: its error, or what `fetch` makes of it. If `fetch` fails, the result is
    /// kept. Returns whether it had ended.
    pub fn take(&mut self, fetch: impl FnOnce(&mut S) -> Result<(), E>) -> Result<bool, E> {
        if !self.wait(Duration::ZERO)? {
            return Ok(false);
        }
        let slot = self.shared.state().done.pop_front();
        let Some(mut slot) = slot else { return Ok(false) };
        let outcome = std::mem::replace(&mut slot.outcome, Ok(()));
        let failed = outcome.is_err();
        let outcome = outcome.and_then(|()| fetch(&mut slot.content));
        let mut state = self.shared.state();
        if outcome.is_err() && !failed {
            slot.kept = true;
            state.done.push_front(slot);
        } else {
            state.live -= 1;
            state.spare.push_back(slot);
        }
        outcome.map(|()| true)
    }

    /// Drops all frames under way. Returns whether they have ended; if not, they end by themselves.
    pub fn cancel(&mut self) -> bool {
        let mut state = self.shared.state();
        if state.live > 0 {
            let done = state.done.len();
            state.drop_done(done);
            state.cancels += 1;
            state.live = 0;
            let State { spare, waiting, lost, .. } = &mut *state;
            for (worker, waiting) in waiting.iter_mut().enumerate() {
                lost.note(worker > 0 && !waiting.is_empty());
                spare.extend(waiting.drain(..));
            }
        }
        state.under_way() == 0
    }
}

impl<S, E> Drop for Queue<S, E> {
    /// Waits for what the workers are at. A frame that no worker has taken is dropped.
    fn drop(&mut self) {
        let mut state = self.shared.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.quit = true;
        drop(state);
        self.shared.changed.notify_all();
        self.threads.clear();
    }
}

#[cfg(test)]
mod tests;
