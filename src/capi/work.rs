//! How an encoder does its work: one frame at a time, or two.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use crate::image::Converter;
use crate::{Encoded, Known, Picture};

use super::encoder::Core;
use super::frame::refused;
use super::image::View;
use super::pipelined::Pipelined;
use super::status::*;
use super::worker::Worker;

/// What an encoder's handle holds.
pub(super) enum Work {
    /// A frame is begun when the one before is finished.
    OneByOne(Worker<Core>),
    /// Two frames may be under way. The converter, which reads images, is also the core's.
    Pipelined(Box<Pipelined>, Arc<Mutex<Converter>>),
}

/// A frame, as a caller gives it.
pub(super) struct Given<'a> {
    pub view: View<'a>,
    pub known: Known,
}

impl Given<'_> {
    /// Converts the image, and hands over what is known of it.
    pub(super) fn take_in(
        &self,
        converter: &Mutex<Converter>,
        frame: &mut Picture,
        known: &mut Known,
    ) -> Result<(), Failure> {
        let mut converter = converter.lock().unwrap_or_else(PoisonError::into_inner);
        converter.convert(&self.view, frame)?;
        *known = self.known;
        Ok(())
    }
}

impl Work {
    /// What the next frame is encoded by. Fails while a frame is searched for, or coded by it.
    pub(super) fn core(&self) -> Result<MutexGuard<'_, Core>, Failure> {
        match self {
            Work::OneByOne(worker) => worker.core(),
            Work::Pipelined(pipelined, _) => pipelined.core(),
        }
    }

    /// Reads a frame on this thread. Others then encode it.
    pub(super) fn begin<'a>(
        &mut self,
        given: impl FnOnce() -> Result<Given<'a>, Failure>,
    ) -> Result<(), Failure> {
        match self {
            Work::OneByOne(worker) => worker.begin(|core| core.take_in(given()?)),
            Work::Pipelined(pipelined, converter) => {
                let given = checked(pipelined, given()?)?;
                pipelined.begin(|frame, known| given.take_in(converter, frame, known))
            }
        }
    }

    /// Encodes a frame and waits for its end.
    pub(super) fn run<'a>(
        &mut self,
        given: impl FnOnce() -> Result<Given<'a>, Failure>,
    ) -> Result<(), Failure> {
        match self {
            Work::OneByOne(worker) => worker.run(|core| core.take_in(given()?)),
            Work::Pipelined(pipelined, converter) => {
                let given = checked(pipelined, given()?)?;
                pipelined.run(|frame, known| given.take_in(converter, frame, known))
            }
        }
    }

    /// Tells whether there is an outcome to take. Waits for it, at most `timeout`.
    pub(super) fn wait(&self, timeout: Duration) -> Result<nvsp_status, Failure> {
        match self {
            Work::OneByOne(worker) => worker.wait(timeout),
            Work::Pipelined(pipelined, _) => pipelined.wait(timeout),
        }
    }

    /// Takes the first outcome: the frame's error, or what `fetch` makes of it. If `fetch` fails, the outcome stays.
    pub(super) fn take(
        &mut self,
        fetch: impl FnOnce(&Encoded) -> Result<(), Failure>,
    ) -> Result<nvsp_status, Failure> {
        match self {
            Work::OneByOne(worker) => worker.take(|core| fetch(&core.encoded)),
            Work::Pipelined(pipelined, _) => pipelined.take(fetch),
        }
    }

    /// Drops what was begun. Tells whether it has ended.
    pub(super) fn cancel(&mut self) -> Result<nvsp_status, Failure> {
        match self {
            Work::OneByOne(worker) => worker.cancel(),
            Work::Pipelined(pipelined, _) => Ok(pipelined.cancel()),
        }
    }

    /// Looks at the last frame: the last that was encoded, or with two under way the last that was finished.
    pub(super) fn with_last(
        &self,
        look: impl FnOnce(&Encoded) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        let none = || Failure::at(NVSP_ERR_STATE, "no frame was encoded");
        match self {
            Work::OneByOne(worker) => {
                let core = worker.core()?;
                look(core.full.then_some(&core.encoded).ok_or_else(none)?)
            }
            Work::Pipelined(pipelined, _) => look(pipelined.last().ok_or_else(none)?),
        }
    }
}

/// Checks what is known of a frame. While another is searched for, what depends on that one is left to the search.
fn checked<'a>(pipelined: &Pipelined, given: Given<'a>) -> Result<Given<'a>, Failure> {
    let checked = match pipelined.core() {
        Ok(core) => core.encoder.check_known(&given.known),
        Err(_) => given.known.check(0, None),
    };
    checked.map_err(refused)?;
    Ok(given)
}
