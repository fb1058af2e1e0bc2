//! A learner beside an encoder, and what it has to tell.

use std::sync::Arc;

use crate::prior::Learnt;
use crate::render::Scene;
use crate::residual::ResidualSetup;
use crate::{Camera, Engine, Error};

use super::{Found, LearnOptions, Learner, LearnerStats, Proven};

/// A place for a learner; at first there is none.
#[derive(Default)]
pub(crate) struct Beside {
    learner: Option<(Learner, LearnOptions)>,
    /// Bytes of the update that was proven last, until they are taken.
    update: Option<Vec<u8>>,
    /// What is learnt with that update, until it is adopted or dropped.
    waiting: Option<Learnt>,
    /// The frame that comes next.
    found: Found,
    /// It was not learnt from yet.
    fresh: bool,
    /// Why learning has ended.
    failed: Option<Error>,
}

impl Beside {
    /// Begins to learn, beside what is learnt already.
    pub fn begin(
        &mut self,
        engine: &Engine,
        scene: &Arc<Scene>,
        camera: &Camera,
        setup: &ResidualSetup,
        learnt: &Learnt,
        options: &LearnOptions,
    ) -> Result<(), Error> {
        let learner = Learner::new(engine, scene, camera, setup, learnt.clone(), options)?;
        *self = Beside { learner: Some((learner, options.clone())), ..Beside::default() };
        Ok(())
    }

    /// Goes on with another camera or device. What was learnt stays. If it fails, learning ends, and
    /// [`work`](Self::work) says why.
    pub fn go_on(
        &mut self,
        engine: &Engine,
        scene: &Arc<Scene>,
        camera: &Camera,
        setup: &ResidualSetup,
    ) {
        let Some((learner, options)) = self.learner.take() else { return };
        let learnt = learner.learnt().clone();
        // The new one takes its room on the device.
        drop(learner);
        let (update, waiting) = (self.update.take(), self.waiting.take());
        let begun = self.begin(engine, scene, camera, setup, &learnt, &options);
        (self.update, self.waiting, self.failed) = (update, waiting, begun.err());
    }

    /// Where to put the next frame; `None`: nobody learns. A frame before it that was not learnt from is left out.
    pub fn next(&mut self) -> Option<&mut Found> {
        self.fresh = self.learner.is_some();
        self.fresh.then_some(&mut self.found)
    }

    /// Lets the learner see the last frame, once, and do its slice of work. While an update waits, it only collects.
    /// If it fails, learning ends.
    pub fn work(&mut self, price: f64) -> Result<(), Error> {
        self.failed.take().map_or(Ok(()), Err)?;
        let Some((learner, _)) = self.learner.as_mut().filter(|_| self.fresh) else {
            return Ok(());
        };
        self.fresh = false;
        let done = match self.waiting {
            Some(_) => learner.collect(&self.found).map(|()| None),
            None => learner.frame(&self.found, price),
        };
        let proven = done.inspect_err(|_| self.learner = None)?;
        if let Some(Proven { after, bytes }) = proven {
            (self.update, self.waiting) = (Some(bytes), Some(after));
        }
        Ok(())
    }

    /// Number of the update that waits to be adopted.
    pub fn waiting(&self) -> Option<u16> {
        self.waiting.as_ref().map(Learnt::number)
    }

    /// Adopts the update that waits, if it has this number; returns what is learnt with it.
    pub fn adopt(&mut self, number: u16) -> Option<Learnt> {
        let after = self.waiting.take_if(|waiting| waiting.number() == number)?;
        self.update = None;
        if let Some((learner, _)) = &mut self.learner {
            learner.adopt(&after);
        }
        Some(after)
    }

    /// Drops the update that waits, if there is one.
    pub fn drop_waiting(&mut self) {
        (self.update, self.waiting) = (None, None);
    }

    /// The update that was given out last, once.
    pub fn take_update(&mut self) -> Option<Vec<u8>> {
        self.update.take()
    }

    /// What the learner did; `None`: there is none.
    pub fn stats(&self) -> Option<LearnerStats> {
        self.learner.as_ref().map(|(learner, _)| learner.stats())
    }
}
