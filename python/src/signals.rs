//! Python's signals while the library works.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use pyo3::prelude::*;

/// Least time between two looks: each waits for the GIL.
const EVERY: Duration = Duration::from_millis(50);

/// What a signal's handler raised: Ctrl-C does.
#[derive(Default)]
pub struct Signals(Arc<Mutex<Option<PyErr>>>);

impl Signals {
    /// What work asks now and then, without the GIL: whether to end.
    pub fn looked_for(&self) -> impl Fn() -> bool + Send + Sync + 'static {
        let (raised, last) = (self.0.clone(), Mutex::new(None::<Instant>));
        move || {
            let mut last = last.lock().unwrap_or_else(PoisonError::into_inner);
            if last.is_some_and(|last| last.elapsed() < EVERY) {
                return false;
            }
            *last = Some(Instant::now());
            let error = Python::attach(|py| py.check_signals()).err();
            let ends = error.is_some();
            *raised.lock().unwrap_or_else(PoisonError::into_inner) = error;
            ends
        }
    }

    /// # Errors
    /// What was raised, once.
    pub fn raised(&self) -> PyResult<()> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).take().map_or(Ok(()), Err)
    }
}
