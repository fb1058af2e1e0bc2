//! What `nvspenc` learns beside its frames, and what those downstream tell of it.

use std::collections::VecDeque;

use nvsprior::learning::LearnOptions;
use nvsprior::prior::{StateId, Update, UpdateError};
use nvsprior::{Encoder, Error};

use crate::dive_file::DiveFile;
use crate::update_event::{Answer, SentUpdate, UpdateName};

/// What those downstream have told.
#[derive(Clone, Copy, Debug, Default)]
pub struct Told {
    /// The update that the topside holds.
    held: Option<UpdateName>,
    /// The update that cannot be sent.
    refused: Option<UpdateName>,
    /// Part of the bit rate that updates take, and their price. `None`: there is no link.
    link: Option<(f64, f64)>,
}

impl Told {
    pub fn take(&mut self, answer: Answer) {
        match answer {
            // A decoder before the link, for a display on the vehicle, is not the topside.
            Answer::Held { over_link: false, .. } if self.link.is_some() => {}
            Answer::Held { name, .. } => self.held = Some(name),
            Answer::Refused(name) => self.refused = Some(name),
            Answer::Link { share, price } => self.link = Some((share, price)),
        }
    }

    /// Part of the bit rate that updates take.
    pub fn share(&self) -> f64 {
        self.link.map_or(0.0, |(share, _)| share)
    }

    fn price(&self) -> f64 {
        self.link.map_or(1.0, |(_, price)| price)
    }
}

/// The updates of an encoder.
pub struct Learning {
    /// There may be updates.
    is_on: bool,
    learns: bool,
    dive_file: Option<DiveFile>,
    /// The update that was proven, and neither adopted nor dropped.
    waiting: Option<SentUpdate>,
    /// Updates that are to be sent.
    unsent: VecDeque<SentUpdate>,
    /// The update that was adopted and is not in the dive file yet.
    unsaved: Option<SentUpdate>,
}

impl Learning {
    /// Has an encoder draw what is in the dive file, and learn. `steps_per_frame`: 0 to learn nothing.
    pub fn begin(
        encoder: &mut Encoder,
        dive_file: Option<DiveFile>,
        steps_per_frame: u32,
    ) -> Result<Learning, Error> {
        let mut unsent = VecDeque::new();
        if let Some(file) = &dive_file {
            for bytes in file.each_bytes()? {
                unsent.push_back(SentUpdate::new(bytes, true)?);
            }
            if !unsent.is_empty() {
                encoder.set_learnt(file.chain().learnt())?;
            }
        }
        let learns = steps_per_frame > 0;
        if learns {
            encoder.learn(&LearnOptions { steps_per_frame, ..LearnOptions::default() })?;
        }
        let is_on = learns || dive_file.is_some();
        Ok(Learning { is_on, learns, dive_file, waiting: None, unsent, unsaved: None })
    }

    /// Before a frame: draws with the update that waits if the topside holds it, drops it if it cannot be sent.
    pub fn follow(&mut self, encoder: &mut Encoder, told: &Told) {
        let Some(waiting) = &self.waiting else { return };
        let name = waiting.name;
        if told.held == Some(name) && encoder.adopt(name.number) {
            self.unsaved = self.waiting.take();
        } else if told.refused == Some(name) {
            encoder.drop_update();
            self.waiting = None;
        }
    }

    /// After a frame, whose packet is on its way: a slice of learning.
    pub fn work(&mut self, encoder: &mut Encoder, told: &Told) -> Result<(), Error> {
        if !self.learns {
            return Ok(());
        }
        encoder.learn_more(told.price()).inspect_err(|_| self.learns = false)?;
        if let Some(bytes) = encoder.take_update() {
            let update = SentUpdate::new(bytes, false)?;
            self.unsent.push_back(update.clone());
            self.waiting = Some(update);
        }
        Ok(())
    }

    /// Keeps the update that was adopted last in the dive file, once.
    pub fn save(&mut self) -> Result<(), UpdateError> {
        match (self.unsaved.take(), &mut self.dive_file) {
            (Some(update), Some(file)) => file.add(Update::read(&update.bytes)?),
            _ => Ok(()),
        }
    }

    /// The next update that is to be sent.
    pub fn next_unsent(&mut self) -> Option<SentUpdate> {
        self.unsent.pop_front()
    }

    /// Sends what waits once more: a flush may have taken it away.
    pub fn send_again(&mut self) {
        if self.unsent.is_empty() {
            self.unsent.extend(self.waiting.clone());
        }
    }

    /// What the encoder draws with; `None`: there are no updates.
    pub fn figures(&self, encoder: &Encoder) -> Option<LearntFigures> {
        let learnt = encoder.learnt();
        self.is_on.then(|| LearntFigures {
            updates: u32::from(learnt.number()),
            splats: learnt.splats().len() as u32,
            update_bytes: encoder.learner_stats().unwrap_or_default().update_bytes as u64,
            state: learnt.state(),
        })
    }
}

/// What an encoder draws with beside the prior.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LearntFigures {
    /// Updates of this dive and of those before.
    updates: u32,
    splats: u32,
    /// Bytes of all updates that were proven on this dive.
    update_bytes: u64,
    state: StateId,
}

impl LearntFigures {
    /// Adds them to others.
    pub fn tell(&self, figures: &mut gst::Structure) {
        figures.set("updates", self.updates);
        figures.set("splats", self.splats);
        figures.set("update-bytes", self.update_bytes);
        figures.set("state", self.state.to_string());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_display_before_the_link_is_not_the_topside() {
        let name = |number| UpdateName { number, state: StateId(5) };
        let held = |number, over_link| Answer::Held { name: name(number), over_link };
        let mut told = Told::default();
        assert_eq!((told.share(), told.price()), (0.0, 1.0));
        told.take(held(1, false));
        assert_eq!(told.held, Some(name(1)));
        told.take(Answer::Link { share: 0.25, price: 1.5 });
        told.take(held(2, false));
        assert_eq!((told.held, told.share(), told.price()), (Some(name(1)), 0.25, 1.5));
        told.take(held(3, true));
        assert_eq!(told.held, Some(name(3)));
    }
}
