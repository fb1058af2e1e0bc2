//! A thread of its own for the work, so that a control loop need not wait for it.

use std::ffi::CStr;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, TryLockError};
use std::time::Duration;

use super::status::*;
use super::thread::{Thread, ThreadStart};

/// A job that is done again and again on `C`, on the caller's thread or on one beside it.
pub(super) struct Worker<C> {
    shared: Arc<Shared<C>>,
    /// Started when it is first needed.
    thread: Option<Thread>,
    job: Job<C>,
    /// What to do with the core after an outcome that nobody took.
    dropped: fn(&mut C),
    name: &'static CStr,
    start: ThreadStart,
}

pub(super) type Job<C> = fn(&mut C) -> Result<(), Failure>;

struct Shared<C> {
    state: Mutex<State>,
    changed: Condvar,
    core: Mutex<C>,
}

enum State {
    /// Nothing was begun, or the last outcome was taken.
    Idle,
    /// Begun.
    Asked,
    /// Begun, but nobody wants the outcome.
    Cancelled,
    /// Begun and ended. The outcome is the caller's to take or to cancel: no other call may drop it.
    Ended(Result<(), Failure>),
    /// An outcome that could not be handed over. The next job drops it.
    Kept,
    /// The thread is to end.
    Quit,
}

impl<C> Shared<C> {
    fn state(&self) -> MutexGuard<'_, State> {
        // No code that could panic runs under this lock.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Keeps an outcome; `false`: nobody wants it.
    fn end(&self, outcome: Result<(), Failure>) -> bool {
        let mut state = self.state();
        let wanted = matches!(*state, State::Asked);
        if wanted {
            *state = State::Ended(outcome);
            self.changed.notify_all();
        }
        wanted
    }

    fn set(&self, state: State) {
        *self.state() = state;
        self.changed.notify_all();
    }
}

impl<C: Send + 'static> Worker<C> {
    /// `name` and `start` are for the thread.
    pub(super) fn new(
        core: C,
        (job, dropped): (Job<C>, fn(&mut C)),
        name: &'static CStr,
        start: ThreadStart,
    ) -> Worker<C> {
        let (state, changed) = (Mutex::new(State::Idle), Condvar::new());
        let shared = Arc::new(Shared { state, changed, core: Mutex::new(core) });
        Worker { shared, thread: None, job, dropped, name, start }
    }

    /// What the job works on. Fails from the job's beginning until its outcome is taken or cancelled.
    pub(super) fn core(&self) -> Result<MutexGuard<'_, C>, Failure> {
        if !matches!(*self.shared.state(), State::Idle | State::Kept) {
            return Err(Failure::at(NVSP_ERR_UNFINISHED, "finish it or cancel it"));
        }
        self.lock()
    }

    fn lock(&self) -> Result<MutexGuard<'_, C>, Failure> {
        self.shared.core.try_lock().map_err(|error| match error {
            TryLockError::Poisoned(_) => Failure::at(NVSP_ERR_POISONED, "the job failed before"),
            TryLockError::WouldBlock => Failure::at(NVSP_ERR_UNFINISHED, "it is ending"),
        })
    }

    /// Does the job on this thread. Once the job is prepared, an outcome that was kept is dropped.
    pub(super) fn run(
        &mut self,
        prepare: impl FnOnce(&mut C) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        let job = self.job;
        {
            let mut core = self.core()?;
            prepare(&mut core)?;
            self.shared.set(State::Idle);
            job(&mut core)?;
        }
        self.shared.set(State::Kept);
        Ok(())
    }

    /// Prepares the job on this thread. The other thread then does it. Once the job is prepared, an outcome that was
    /// kept is dropped.
    pub(super) fn begin(
        &mut self,
        prepare: impl FnOnce(&mut C) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        {
            let mut core = self.core()?;
            prepare(&mut core)?;
            self.shared.set(State::Idle);
        }
        if self.thread.is_none() {
            let (shared, job) = (self.shared.clone(), self.job);
            let dropped = self.dropped;
            let body = move || serve(&shared, job, dropped);
            self.thread = Some(Thread::spawn(self.name, self.start, body)?);
        }
        self.shared.set(State::Asked);
        Ok(())
    }

    /// Tells whether there is an outcome to take. Waits for it, at most `timeout`.
    pub(super) fn wait(&self, timeout: Duration) -> Result<nvsp_status, Failure> {
        let asked = |state: &mut State| matches!(state, State::Asked | State::Cancelled);
        let changed = &self.shared.changed;
        let (state, _) = changed
            .wait_timeout_while(self.shared.state(), timeout, asked)
            .unwrap_or_else(PoisonError::into_inner);
        match *state {
            State::Asked | State::Cancelled => Ok(NVSP_PENDING),
            State::Ended(_) | State::Kept => Ok(NVSP_OK),
            State::Idle | State::Quit => Err(Failure::at(NVSP_ERR_STATE, "nothing was begun")),
        }
    }

    /// Drops the job that was begun, or its outcome. Tells whether it has ended; if it has not, it ends by itself.
    pub(super) fn cancel(&mut self) -> Result<nvsp_status, Failure> {
        let mut state = self.shared.state();
        match *state {
            State::Idle | State::Quit => Ok(NVSP_OK),
            State::Asked | State::Cancelled => {
                *state = State::Cancelled;
                Ok(NVSP_PENDING)
            }
            State::Ended(_) | State::Kept => {
                *state = State::Idle;
                drop(state);
                (self.dropped)(&mut *self.lock()?);
                Ok(NVSP_OK)
            }
        }
    }

    /// Takes the outcome: the job's error, or what `fetch` makes of the core. If `fetch` fails, the outcome is kept.
    pub(super) fn take(
        &mut self,
        fetch: impl FnOnce(&C) -> Result<(), Failure>,
    ) -> Result<nvsp_status, Failure> {
        if self.wait(Duration::ZERO)? == NVSP_PENDING {
            return Ok(NVSP_PENDING);
        }
        let done = std::mem::replace(&mut *self.shared.state(), State::Idle);
        if let State::Ended(Err(failure)) = done {
            return Err(failure);
        }
        let fetched = self.lock().and_then(|core| fetch(&core));
        if fetched.is_err() {
            self.shared.set(State::Kept);
        }
        fetched.map(|()| NVSP_OK)
    }
}

impl<C> Drop for Worker<C> {
    /// Waits for a job that was begun.
    fn drop(&mut self) {
        if let Some(thread) = self.thread.take() {
            let asked = |state: &mut State| matches!(state, State::Asked | State::Cancelled);
            let changed = &self.shared.changed;
            let ended = changed.wait_while(self.shared.state(), asked);
            *ended.unwrap_or_else(PoisonError::into_inner) = State::Quit;
            changed.notify_all();
            // The thread catches what the job panics with.
            drop(thread);
        }
    }
}

/// The thread: does the job whenever it is asked for.
fn serve<C>(shared: &Shared<C>, job: Job<C>, dropped: fn(&mut C)) {
    loop {
        let rest = |state: &mut State| matches!(state, State::Idle | State::Ended(_) | State::Kept);
        let state = shared.changed.wait_while(shared.state(), rest);
        if matches!(*state.unwrap_or_else(PoisonError::into_inner), State::Quit) {
            return;
        }
        // A panic poisons the core's lock, so that no later call gets by.
        let outcome = catch_unwind(AssertUnwindSafe(|| match shared.core.lock() {
            Ok(mut core) => job(&mut core),
            Err(_) => Err(Failure::at(NVSP_ERR_POISONED, "the job failed before")),
        }));
        let panicked = |_| Err(Failure::at(NVSP_ERR_INTERNAL, "please report it"));
        let outcome = outcome.unwrap_or_else(panicked);
        if shared.end(outcome) {
            continue;
        }
        if let Ok(mut core) = shared.core.lock() {
            dropped(&mut core);
        }
        shared.set(State::Idle);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LONG: Duration = Duration::from_secs(60);

    /// Counts; fails at 3, panics at 5.
    fn count(core: &mut u32) -> Result<(), Failure> {
        *core += 1;
        match *core {
            3 => Err(Failure::argument("three")),
            5 => panic!("on purpose"),
            _ => Ok(()),
        }
    }

    fn worker(core: u32, job: Job<u32>) -> Worker<u32> {
        let start = ThreadStart { callback: None, user: std::ptr::null_mut() };
        Worker::new(core, (job, |core| *core += 100), c"nvsp-test", start)
    }

    fn status<R>(result: Result<R, Failure>) -> Option<nvsp_status> {
        result.err().map(|failure| failure.status())
    }

    #[test]
    fn outcomes_are_taken_once_and_failures_end_their_job_only() {
        let mut worker = worker(0, count);
        assert_eq!(status(worker.wait(Duration::ZERO)), Some(NVSP_ERR_STATE));
        worker.begin(|_| Ok(())).unwrap();
        assert_eq!(worker.wait(LONG).unwrap(), NVSP_OK);
        assert_eq!(status(worker.take(|_| Err(Failure::Room { needed: 2, found: 1 }))), Some(-5));
        let mut seen = 0;
        let take = |core: &u32, seen: &mut u32| {
            *seen = *core;
            Ok(())
        };
        assert_eq!(worker.take(|core| take(core, &mut seen)).unwrap(), NVSP_OK);
        assert_eq!(seen, 1);
        assert_eq!(status(worker.take(|_| Ok(()))), Some(NVSP_ERR_STATE));
        worker.run(|_| Ok(())).unwrap();
        worker.begin(|_| Ok(())).unwrap();
        assert_eq!(worker.wait(LONG).unwrap(), NVSP_OK);
        assert_eq!(status(worker.take(|_| Ok(()))), Some(NVSP_ERR_ARGUMENT));
        assert_eq!(*worker.core().unwrap(), 3);
    }

    #[test]
    fn only_an_outcome_that_could_not_be_handed_over_is_dropped_by_the_next_job() {
        let mut worker = worker(10, count);
        worker.begin(|_| Ok(())).unwrap();
        assert_eq!(worker.wait(LONG).unwrap(), NVSP_OK);
        assert_eq!(status(worker.core()), Some(NVSP_ERR_UNFINISHED));
        assert_eq!(status(worker.begin(|_| Ok(()))), Some(NVSP_ERR_UNFINISHED));
        assert_eq!(status(worker.run(|_| Ok(()))), Some(NVSP_ERR_UNFINISHED));
        assert_eq!(status(worker.take(|_| Err(Failure::Room { needed: 2, found: 1 }))), Some(-5));
        assert_eq!(*worker.core().unwrap(), 11);
        worker.begin(|_| Ok(())).unwrap();
        worker.wait(LONG).unwrap();
        worker.take(|_| Ok(())).unwrap();
        assert_eq!(*worker.core().unwrap(), 12);
    }

    #[test]
    fn a_panic_on_the_thread_is_told_and_ends_the_worker() {
        let mut worker = worker(4, count);
        worker.begin(|_| Ok(())).unwrap();
        worker.wait(LONG).unwrap();
        assert_eq!(status(worker.take(|_| Ok(()))), Some(NVSP_ERR_INTERNAL));
        assert_eq!(status(worker.begin(|_| Ok(()))), Some(NVSP_ERR_POISONED));
    }

    #[test]
    fn what_was_begun_is_left_alone_until_it_ends() {
        fn slow(_: &mut u32) -> Result<(), Failure> {
            std::thread::sleep(Duration::from_millis(200));
            Ok(())
        }
        let mut worker = worker(0, slow);
        worker.begin(|_| Ok(())).unwrap();
        assert_eq!(status(worker.core()), Some(NVSP_ERR_UNFINISHED));
        assert_eq!(status(worker.begin(|_| Ok(()))), Some(NVSP_ERR_UNFINISHED));
        assert_eq!(worker.take(|_| Ok(())).unwrap(), NVSP_PENDING);
        assert_eq!(worker.wait(LONG).unwrap(), NVSP_OK);
        assert_eq!(worker.take(|_| Ok(())).unwrap(), NVSP_OK);
        worker.begin(|_| Ok(())).unwrap();
        drop(worker); // Waits, and does not hang.
    }

    #[test]
    fn what_is_cancelled_ends_without_an_outcome() {
        fn slow(core: &mut u32) -> Result<(), Failure> {
            std::thread::sleep(Duration::from_millis(100));
            *core += 1;
            Ok(())
        }
        let mut worker = worker(0, slow);
        assert_eq!(worker.cancel().unwrap(), NVSP_OK, "nothing was begun");
        worker.begin(|_| Ok(())).unwrap();
        assert_eq!(worker.cancel().unwrap(), NVSP_PENDING);
        assert_eq!(status(worker.begin(|_| Ok(()))), Some(NVSP_ERR_UNFINISHED));
        assert_eq!(
            status(worker.wait(LONG)),
            Some(NVSP_ERR_STATE),
            "it ended, and nothing is left"
        );
        assert_eq!(*worker.core().unwrap(), 101);
        worker.begin(|_| Ok(())).unwrap();
        assert_eq!(worker.wait(LONG).unwrap(), NVSP_OK);
        assert_eq!(worker.cancel().unwrap(), NVSP_OK);
        assert_eq!(*worker.core().unwrap(), 202);
        worker.begin(|_| Ok(())).unwrap();
        worker.cancel().unwrap();
        drop(worker); // Waits, and does not hang.
    }
}
