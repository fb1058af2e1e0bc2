//! A learner beside an encoder, and what it has to tell.

use std::sync::Arc;

use crate::prior::Learnt;
use crate::render::Scene;
use crate::residual::ResidualSetup;
use crate::{Camera, Engine, Error};

use super::{Found, LearnOptions, Learner, LearnerStats};

/// A place for a learner; at first there is none.
#[derive(Default)]
pub(crate) struct Beside {
    learner: Option<(Learner, LearnOptions)>,
    update: Option<Vec<u8>>,
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
    /// [`take_update`](Self::take_update) says why.
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
        let update = self.update.take();
        let begun = self.begin(engine, scene, camera, setup, &learnt, &options);
        (self.update, self.failed) = (update, begun.err());
    }

    /// Lets the learner see a frame, and do its slice of work. Returns what is learnt, if that has changed.
    pub fn frame(&mut self, found: &Found) -> Option<Learnt> {
        // An update that nobody took would be missing on the other side.
        if self.update.is_some() {
            return None;
        }
        let (learner, _) = self.learner.as_mut()?;
        match learner.frame(found) {
            Ok(update) => {
                self.update = update;
                self.update.is_some().then(|| learner.learnt().clone())
            }
            Err(error) => {
                (self.failed, self.learner) = (Some(error), None);
                None
            }
        }
    }

    /// The update that was given out last, once.
    pub fn take_update(&mut self) -> Result<Option<Vec<u8>>, Error> {
        match (self.update.take(), self.failed.take()) {
            (None, Some(error)) => Err(error),
            (update, failed) => {
                self.failed = failed;
                Ok(update)
            }
        }
    }

    /// What the learner did; `None`: there is none.
    pub fn stats(&self) -> Option<LearnerStats> {
        self.learner.as_ref().map(|(learner, _)| learner.stats())
    }
}
