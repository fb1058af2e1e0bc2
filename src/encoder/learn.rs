//! Learning beside the encoder.

use crate::frame_work::FrameWork;
use crate::learning::{Found, LearnOptions, Learner, LearnerStats};
use crate::prior::Learnt;
use crate::{Error, Picture};

use super::Encoder;

/// A learner, and what it has to tell.
#[derive(Default)]
pub(super) struct Learning {
    learner: Option<(Learner, LearnOptions)>,
    update: Option<Vec<u8>>,
    failed: Option<Error>,
}

impl Encoder {
    /// Learns from here on: what frames show and the prior does not becomes updates of the prior. `learnt`: what was
    /// learnt on dives before; `None`: nothing.
    ///
    /// # Errors
    /// If the scene was not [uploaded for updates](crate::Engine::upload_for_updates), if `learnt` is of another prior,
    /// or if the device has no room.
    pub fn learn(&mut self, learnt: Option<Learnt>, options: &LearnOptions) -> Result<(), Error> {
        let learnt = learnt.unwrap_or_else(|| Learnt::none(self.scene.id()));
        self.scene.check_learnt(&learnt)?;
        let learner = self.learner(learnt.clone(), options)?;
        self.learning =
            Learning { learner: Some((learner, options.clone())), ..Learning::default() };
        self.show(learnt);
        Ok(())
    }

    fn learner(&self, learnt: Learnt, options: &LearnOptions) -> Result<Learner, Error> {
        self.scene.show(&learnt)?;
        let setup = self.residual_setup();
        Learner::new(&self.engine, &self.scene, &self.camera, &setup, learnt, options)
    }

    /// The update that the last frame proved, `.nvsu`; `None`: it proved none. Packets of later frames need it. If it is
    /// not taken before the next frame, it stays until it is.
    ///
    /// # Errors
    /// If learning has failed. It has ended then; what was learnt before stays.
    pub fn take_update(&mut self) -> Result<Option<Vec<u8>>, Error> {
        match self.learning.failed.take() {
            Some(error) => Err(error),
            None => Ok(self.learning.update.take()),
        }
    }

    /// What was learnt, and how; `None`: the encoder does not learn.
    pub fn learnt(&self) -> Option<(&Learnt, LearnerStats)> {
        self.learning.learner.as_ref().map(|(learner, _)| (learner.learnt(), learner.stats()))
    }

    /// Lets the learner see a frame that is coded, and do its slice of work.
    pub(super) fn learn_from(&mut self, work: &FrameWork, render: &Picture) {
        let Some((learner, _)) = &mut self.learning.learner else { return };
        // An update that nobody took would be missing on the other side.
        if self.learning.update.is_some() {
            return;
        }
        let found = Found {
            number: work.found.number,
            frame: &work.frame,
            render,
            pose: &work.pose,
            certain: work.found.certain,
            mask: work.mask.as_deref(),
            rate: work.rate,
        };
        match learner.frame(&found) {
            Ok(update) => {
                let learnt = update.is_some().then(|| learner.learnt().clone());
                if let Some(learnt) = learnt {
                    self.show(learnt);
                }
                self.learning.update = update;
            }
            Err(error) => {
                self.learning.failed = Some(error);
                self.learning.learner = None;
            }
        }
    }

    /// Goes on learning with another camera or device.
    pub(super) fn learn_again(&mut self) -> Result<(), Error> {
        let Some((learner, options)) = self.learning.learner.take() else { return Ok(()) };
        let learnt = learner.learnt().clone();
        drop(learner);
        let learner = self.learner(learnt, &options)?;
        self.learning.learner = Some((learner, options));
        Ok(())
    }
}
