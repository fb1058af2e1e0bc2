//! Two frames under way: while one thread codes the difference picture of a frame, another searches for the pose of the
//! next.

use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use crate::pipeline::Coder;
use crate::tracked_frame::TrackedFrame;
use crate::{Camera, Encoded, Known, Picture};

use super::encoder::Core;
use super::limits::Limits;
use super::status::*;
use super::thread::{Thread, ThreadStart};

/// Frames that may be under way.
const FRAMES: usize = 2;
/// Frames that take memory after a change of size: there is a picture more than [`FRAMES`], that of the frame finished
/// last.
pub(super) const COLD: usize = FRAMES + 1;

/// A frame on its way. It is used again for another one.
struct Parcel {
    frame: Picture,
    known: Known,
    tracked: TrackedFrame,
    encoded: Encoded,
    /// What the search, or all of it, came to.
    outcome: Result<(), Failure>,
    /// [`State::cancels`] when it was begun.
    begun_at: u64,
    /// It could not be handed over. The next frame that is encoded in one call drops it.
    kept: bool,
}

type Queue = VecDeque<Box<Parcel>>;

/// A frame goes from `spare` to `asked`, to the thread that searches, to `tracked`, to the thread that codes, to `done`,
/// and back. Frames never overtake each other.
struct State {
    spare: Queue,
    asked: Queue,
    searching: bool,
    tracked: Queue,
    done: Queue,
    /// Frames that were begun and neither finished nor cancelled.
    live: usize,
    /// How often all that was under way was cancelled.
    cancels: u64,
    /// A packet that may have told the camera is lost.
    announce: bool,
    poisoned: bool,
    quit: bool,
}

struct Shared {
    core: Mutex<Core>,
    limits: Limits,
    state: Mutex<State>,
    changed: Condvar,
}

/// Encodes frames in two halves at once.
pub(super) struct Pipelined {
    shared: Arc<Shared>,
    /// Started with the first frame.
    threads: Vec<Thread>,
    start: ThreadStart,
    /// The frame finished last.
    last: Encoded,
    /// Whether there is one.
    full: bool,
}

const TWO: &str = "two frames are under way: finish the first, or cancel both";

fn poisoned() -> Failure {
    Failure::at(NVSP_ERR_POISONED, "the job failed before")
}

impl State {
    fn under_way(&self) -> usize {
        FRAMES - self.spare.len()
    }
}

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        // No code that could panic runs under this lock.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for a frame of a queue; `None`: the thread is to end.
    fn next(&self, queue: fn(&mut State) -> &mut Queue, searches: bool) -> Option<Box<Parcel>> {
        let rest = |state: &mut State| queue(state).is_empty() && !state.quit;
        let state = self.changed.wait_while(self.state(), rest);
        let mut state = state.unwrap_or_else(PoisonError::into_inner);
        if state.quit {
            return None;
        }
        state.searching |= searches;
        queue(&mut state).pop_front()
    }

    /// Passes a frame on, unless it was cancelled meanwhile.
    fn pass(&self, parcel: Box<Parcel>, queue: fn(&mut State) -> &mut Queue, searched: bool) {
        let mut state = self.state();
        state.searching &= !searched;
        if parcel.begun_at == state.cancels {
            queue(&mut state).push_back(parcel);
        } else {
            state.announce = true;
            state.spare.push_back(parcel);
        }
        self.changed.notify_all();
    }

    /// Does a part of a frame's work. A panic ends the encoder.
    fn guard(&self, work: impl FnOnce() -> Result<(), Failure>) -> Result<(), Failure> {
        catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|_| {
            self.state().poisoned = true;
            Err(Failure::at(NVSP_ERR_INTERNAL, "please report it"))
        })
    }

    /// The thread that searches.
    fn search(&self) {
        while let Some(mut parcel) = self.next(|state| &mut state.asked, true) {
            let announce = std::mem::take(&mut self.state().announce);
            let Parcel { frame, known, tracked, .. } = &mut *parcel;
            parcel.outcome = self.guard(|| {
                let mut core = self.core.lock().map_err(|_| poisoned())?;
                if announce {
                    core.encoder.announce();
                }
                core.track(frame, known, tracked)
            });
            self.pass(parcel, |state| &mut state.tracked, true);
        }
    }

    /// The thread that codes.
    fn code(&self) {
        let mut coder = Coder::default();
        let mut cold = 0;
        while let Some(mut parcel) = self.next(|state| &mut state.tracked, false) {
            if parcel.outcome.is_ok() {
                let Parcel { tracked, encoded, .. } = &mut *parcel;
                let tells_camera = tracked.camera.is_some();
                let outcome = self.guard(|| {
                    cold = if coder.changes(tracked) { COLD } else { cold };
                    let size = (tracked.frame.width, tracked.frame.height);
                    let _memory = (cold > 0).then(|| self.limits.coder(size)).transpose()?;
                    coder.code(tracked, encoded)?;
                    cold = cold.saturating_sub(1);
                    Ok(())
                });
                self.state().announce |= outcome.is_err() && tells_camera;
                parcel.outcome = outcome;
            }
            self.pass(parcel, |state| &mut state.done, false);
        }
    }
}

impl Parcel {
    fn new(camera: &Camera) -> Box<Parcel> {
        let Camera { width, height, .. } = *camera;
        Box::new(Parcel {
            frame: Picture::new(width, height),
            known: Known::default(),
            tracked: TrackedFrame::with_room(width, height),
            encoded: Encoded::with_room(width, height),
            outcome: Ok(()),
            begun_at: 0,
            kept: false,
        })
    }
}

impl Pipelined {
    /// `start` is for the threads.
    pub(super) fn new(core: Core, start: ThreadStart) -> Pipelined {
        let camera = *core.encoder.camera();
        let room = || VecDeque::with_capacity(FRAMES);
        let state = State {
            spare: std::iter::repeat_with(|| Parcel::new(&camera)).take(FRAMES).collect(),
            asked: room(),
            searching: false,
            tracked: room(),
            done: room(),
            live: 0,
            cancels: 0,
            announce: false,
            poisoned: false,
            quit: false,
        };
        let (limits, changed) = (core.limits, Condvar::new());
        let shared = Shared { core: Mutex::new(core), limits, state: Mutex::new(state), changed };
        Pipelined {
            shared: Arc::new(shared),
            threads: Vec::with_capacity(2),
            start,
            last: Encoded::with_room(camera.width, camera.height),
            full: false,
        }
    }

    /// What the next frame is encoded by. Fails while a frame is searched for.
    pub(super) fn core(&self) -> Result<MutexGuard<'_, Core>, Failure> {
        let state = self.shared.state();
        if state.poisoned {
            return Err(poisoned());
        }
        if state.searching || !state.asked.is_empty() {
            let what = "a frame is searched for: wait, or cancel it";
            return Err(Failure::at(NVSP_ERR_UNFINISHED, what));
        }
        drop(state);
        // No frame can be begun meanwhile: the caller has the handle for itself.
        self.shared.core.lock().map_err(|_| poisoned())
    }

    /// Begins a frame; `take_in` reads it. Fails if two are under way.
    pub(super) fn begin(
        &mut self,
        take_in: impl FnOnce(&mut Picture, &mut Known) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        let mut parcel = {
            let mut state = self.shared.state();
            if state.poisoned {
                return Err(poisoned());
            }
            if state.under_way() > state.live {
                let what = "a frame that was cancelled has not ended yet";
                return Err(Failure::at(NVSP_ERR_UNFINISHED, what));
            }
            state.spare.pop_front().ok_or(Failure::at(NVSP_ERR_UNFINISHED, TWO))?
        };
        let begun = take_in(&mut parcel.frame, &mut parcel.known);
        let begun = begun.and_then(|()| self.start_threads());
        let mut state = self.shared.state();
        if let Err(failure) = begun {
            state.spare.push_front(parcel);
            return Err(failure);
        }
        (parcel.begun_at, parcel.outcome, parcel.kept) = (state.cancels, Ok(()), false);
        state.live += 1;
        state.asked.push_back(parcel);
        self.shared.changed.notify_all();
        Ok(())
    }

    fn start_threads(&mut self) -> Result<(), Failure> {
        let works: [(_, fn(&Shared)); 2] =
            [(c"nvsp-encoder", Shared::search), (c"nvsp-coder", Shared::code)];
        for (name, work) in &works[self.threads.len()..] {
            let (shared, work) = (self.shared.clone(), *work);
            self.threads.push(Thread::spawn(name, self.start, move || work(&shared))?);
        }
        Ok(())
    }

    /// Encodes a frame and waits for its end. Fails if another was begun and not taken. Frames that are kept are dropped
    /// once this one is begun.
    pub(super) fn run(
        &mut self,
        take_in: impl FnOnce(&mut Picture, &mut Known) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        let kept = {
            let state = self.shared.state();
            let kept = state.done.iter().filter(|parcel| parcel.kept).count();
            if state.under_way() > kept {
                return Err(Failure::at(NVSP_ERR_UNFINISHED, "finish it or cancel it"));
            }
            kept
        };
        self.begin(take_in)?;
        let mut state = self.shared.state();
        for _ in 0..kept {
            if let Some(parcel) = state.done.pop_front() {
                state.spare.push_back(parcel);
                state.live -= 1;
            }
        }
        let pending = |state: &mut State| state.done.is_empty();
        let state = self.shared.changed.wait_while(state, pending);
        for parcel in &mut state.unwrap_or_else(PoisonError::into_inner).done {
            parcel.kept = true;
        }
        Ok(())
    }

    /// Tells whether the first frame under way has ended. Waits for that, at most `timeout`.
    pub(super) fn wait(&self, timeout: Duration) -> Result<nvsp_status, Failure> {
        let pending = |state: &mut State| state.done.is_empty() && state.under_way() > 0;
        let (state, _) = self
            .shared
            .changed
            .wait_timeout_while(self.shared.state(), timeout, pending)
            .unwrap_or_else(PoisonError::into_inner);
        match (state.done.is_empty(), state.under_way()) {
            (false, _) => Ok(NVSP_OK),
            (true, 0) => Err(Failure::at(NVSP_ERR_STATE, "nothing was begun")),
            (true, _) => Ok(NVSP_PENDING),
        }
    }

    /// Takes the first frame: its error, or what `fetch` makes of it. If `fetch` fails, the frame is kept.
    pub(super) fn take(
        &mut self,
        fetch: impl FnOnce(&Encoded) -> Result<(), Failure>,
    ) -> Result<nvsp_status, Failure> {
        if self.wait(Duration::ZERO)? == NVSP_PENDING {
            return Ok(NVSP_PENDING);
        }
        let parcel = self.shared.state().done.pop_front();
        let Some(mut parcel) = parcel else { return Ok(NVSP_PENDING) };
        let outcome = std::mem::replace(&mut parcel.outcome, Ok(()));
        let failed = outcome.is_err();
        let outcome = outcome.and_then(|()| fetch(&parcel.encoded));
        let mut state = self.shared.state();
        if outcome.is_err() && !failed {
            parcel.kept = true;
            state.done.push_front(parcel);
        } else {
            if !failed {
                std::mem::swap(&mut self.last, &mut parcel.encoded);
                self.full = true;
            }
            state.live -= 1;
            state.spare.push_back(parcel);
        }
        outcome.map(|()| NVSP_OK)
    }

    /// Drops all frames under way. Tells whether they have ended; if not, they end by themselves.
    pub(super) fn cancel(&mut self) -> nvsp_status {
        let mut state = self.shared.state();
        if state.live > 0 {
            // What was searched for may have been told of as sent.
            state.announce |= state.live > state.asked.len();
            state.cancels += 1;
            state.live = 0;
            let State { spare, asked, tracked, done, .. } = &mut *state;
            for queue in [asked, tracked, done] {
                spare.extend(queue.drain(..));
            }
        }
        if state.under_way() == 0 { NVSP_OK } else { NVSP_PENDING }
    }

    /// The frame finished last.
    pub(super) fn last(&self) -> Option<&Encoded> {
        self.full.then_some(&self.last)
    }
}

impl Drop for Pipelined {
    /// Waits for what the threads are at. A frame that no thread has taken is dropped.
    fn drop(&mut self) {
        self.shared.state().quit = true;
        self.shared.changed.notify_all();
        self.threads.clear();
    }
}
