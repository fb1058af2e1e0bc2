//! The states of a prior that a topside holds: the prior alone, and what it is after each of the newest updates.

use crate::Camera;
use crate::packet::{Latent, Session};
use crate::prior::{Learnt, StateId, Update};
use crate::render::Scene;

use super::Error;

/// States that are held beside the prior alone: so many updates may be new to packets that arrive late.
const HELD: usize = 8;

/// The states that packets may be about.
pub(super) struct States {
    /// The prior alone, then the newest states of the chain in their order.
    held: Vec<Learnt>,
    /// All states of the chain, whether they are still held or not.
    chain: Vec<StateId>,
    /// The number modulo 256 and the state that a packet in the full form named last.
    named: Option<(u8, StateId)>,
}

impl States {
    pub fn new(scene: &Scene) -> States {
        States { held: vec![Learnt::none(scene.id())], chain: Vec::new(), named: None }
    }

    /// The newest one.
    pub fn newest(&self) -> usize {
        self.held.len() - 1
    }

    pub fn learnt(&self, index: usize) -> &Learnt {
        &self.held[index]
    }

    /// All that are held beside the prior alone, newest first.
    pub fn all(&self) -> impl Iterator<Item = &Learnt> {
        self.held[1..].iter().rev()
    }

    /// Adds an update that stands on a state that is held. If that is not the newest one, the vehicle has begun anew
    /// from there: the states after it go. An update that the chain has already changes nothing. If it stands on a
    /// state that is not held any more, all go: the chain must come again.
    pub fn add(&mut self, update: &Update) -> Result<(), Error> {
        let base = self.held.iter().rposition(|learnt| learnt.state() == update.before);
        let mut learnt = self.held[base.unwrap_or(self.newest())].clone();
        let in_chain = |state| self.chain.contains(&state);
        if update.prior == learnt.prior() && in_chain(update.state()) {
            return Ok(());
        }
        if base.is_none() && in_chain(update.before) {
            self.held.truncate(1);
            self.chain.clear();
        }
        learnt.add(update)?;
        self.held.truncate(base.unwrap_or(0) + 1);
        let stands_on = self.chain.iter().position(|state| *state == update.before);
        let gone = self.chain.split_off(stands_on.map_or(0, |place| place + 1));
        // What packets of the old chain have named says nothing of the new one.
        self.named = self.named.filter(|(_, state)| !gone.contains(state));
        self.push(learnt);
        Ok(())
    }

    /// Begins with what was learnt before: the updates of an earlier dive.
    pub fn begin(&mut self, learnt: Learnt) {
        self.held.truncate(1);
        self.chain.clear();
        self.push(learnt);
    }

    fn push(&mut self, learnt: Learnt) {
        if self.held.len() > HELD {
            self.held.remove(1);
        }
        self.chain.push(learnt.state());
        self.held.push(learnt);
    }

    /// Notes the state that a packet in the full form names.
    pub fn note(&mut self, latent: &Latent) {
        if let (Some(number), Session::Stated { prior, .. }) = (latent.update, latent.session) {
            self.named = Some((number, StateId(prior.0)));
        }
    }

    /// The state that a packet is about, if its camera is this one; `None`: it is not held. The tag of the short form
    /// has eight bits. If a packet in the full form has named another state of that number, the tag fits by chance.
    pub fn of(&self, latent: &Latent, camera: &Camera) -> Option<usize> {
        let named = |learnt: &Learnt| {
            let number = learnt.number() as u8;
            let other = self.named.is_some_and(|(n, s)| n == number && s != learnt.state());
            latent.update == (learnt.number() > 0).then_some(number)
                && !(other && matches!(latent.session, Session::Tagged(_)))
                && latent.session.check(learnt.state().into(), camera).is_ok()
        };
        self.held.iter().rposition(named)
    }
}
