//! The fence between Python's threads and the library.

use std::ops::{Deref, DerefMut};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Mutex, MutexGuard, TryLockError};

use nvsprior::parts::FloatEnvironment;
use pyo3::prelude::*;

use crate::errors::{Failure, Kind};

/// What belongs to the process that made it: it may have a device, or threads. After a fork the child has neither, so
/// there it is of no use, and its end does nothing.
pub struct Owned<T> {
    value: Option<T>,
    process: u32,
}

impl<T> Owned<T> {
    pub fn new(value: T) -> Owned<T> {
        Owned { value: Some(value), process: std::process::id() }
    }

    /// # Errors
    /// `ForkedError` in another process than the one that made it.
    pub fn get(&self) -> Result<&T, Failure> {
        let here = self.process == std::process::id();
        self.value.as_ref().filter(|_| here).ok_or_else(|| {
            let text = "this object was made in another process: a child made by fork has no device and no threads of \
                        its parent. Make it in the child, or start the child by spawn: \
                        multiprocessing.get_context(\"spawn\")";
            Failure::new(Kind::Forked, text)
        })
    }
}

impl<T> Drop for Owned<T> {
    fn drop(&mut self) {
        if self.process != std::process::id() {
            std::mem::forget(self.value.take());
        }
    }
}

/// What one thread at a time may use.
pub struct Handle<T>(Owned<Mutex<Content<T>>>);

struct Content<T> {
    value: T,
    /// A call on it panicked.
    broken: bool,
}

/// A call on a handle.
pub struct Call<'a, T>(MutexGuard<'a, Content<T>>);

impl<T> Handle<T> {
    pub fn new(value: T) -> Handle<T> {
        Handle(Owned::new(Mutex::new(Content { value, broken: false })))
    }

    /// Begins a call. Nobody waits, so nobody waits for ever.
    ///
    /// # Errors
    /// As [`Owned::get`]; `BusyError` if another thread is inside a call; `InternalError` if an earlier call panicked.
    pub fn enter(&self) -> Result<Call<'_, T>, Failure> {
        match self.0.get()?.try_lock() {
            Ok(content) if !content.broken => Ok(Call(content)),
            Err(TryLockError::WouldBlock) => {
                Err(Failure::new(Kind::Busy, "another thread is inside a call on this object"))
            }
            _ => Err(Failure::new(
                Kind::Internal,
                "an earlier call on this object failed inside the library: make a new one",
            )),
        }
    }
}

impl<T: Send> Call<'_, T> {
    /// Works without the GIL. After a panic the handle is of no use.
    pub fn detached<R: Send>(
        &mut self,
        py: Python,
        work: impl FnOnce(&mut T) -> Result<R, Failure> + Send,
    ) -> Result<R, Failure> {
        let Content { value, broken } = &mut *self.0;
        *broken = true;
        detached(py, || {
            let done = work(value);
            *broken = false;
            done
        })
    }
}

impl<T> Deref for Call<'_, T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.0.value
    }
}

impl<T> DerefMut for Call<'_, T> {
    fn deref_mut(&mut self) -> &mut T {
        &mut self.0.value
    }
}

/// Works without the GIL.
///
/// # Errors
/// `InternalError` after a panic.
pub fn detached<R: Send>(
    py: Python,
    work: impl FnOnce() -> Result<R, Failure> + Send,
) -> Result<R, Failure> {
    py.detach(|| {
        let _environment = FloatEnvironment::enter();
        catch_unwind(AssertUnwindSafe(work))
    })
    .unwrap_or_else(|_| {
        Err(Failure::new(Kind::Internal, "a fault inside the library: please report it"))
    })
}
