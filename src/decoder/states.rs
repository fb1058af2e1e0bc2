//! The states of a prior that a topside holds: the prior alone, and what it is after each of the newest updates.

use crate::Camera;
use crate::packet::Latent;
use crate::prior::{Learnt, Update};
use crate::render::Scene;

use super::Error;

/// States that are held beside the prior alone: so many updates may be new to packets that arrive late.
const HELD: usize = 8;

/// The states that packets may be about.
pub(super) struct States {
    /// The prior alone, then the newest states in their order.
    held: Vec<Learnt>,
}

impl States {
    pub fn new(scene: &Scene) -> States {
        States { held: vec![Learnt::none(scene.id())] }
    }

    /// The newest one.
    pub fn newest(&self) -> usize {
        self.held.len() - 1
    }

    pub fn learnt(&self, index: usize) -> &Learnt {
        &self.held[index]
    }

    /// Adds the next update.
    pub fn add(&mut self, update: &Update) -> Result<(), Error> {
        let mut learnt = self.held[self.newest()].clone();
        learnt.add(update)?;
        self.push(learnt);
        Ok(())
    }

    /// Adds a state that is not the next one: that of an earlier dive.
    pub fn push(&mut self, learnt: Learnt) {
        if self.held.len() > HELD {
            self.held.remove(1);
        }
        self.held.push(learnt);
    }

    /// The state that a packet is about, if its camera is this one; `None`: it is not held.
    pub fn of(&self, latent: &Latent, camera: &Camera) -> Option<usize> {
        let named = |learnt: &Learnt| {
            let number = learnt.number();
            latent.update == (number > 0).then_some(number as u8)
                && latent.session.check(learnt.state().into(), camera).is_ok()
        };
        self.held.iter().rposition(named)
    }
}
