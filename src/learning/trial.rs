//! An update while it is thinned out and judged, by frames that it was not learnt from.

use crate::prior::{Learnt, Update, UpdateError};

use super::worth::Part;

/// Fewest splats that an update is worth.
pub const FEWEST: usize = 6;
/// About what a new splat of an update takes, and a change, bytes.
const NEW_BYTES: f64 = 6.4;
/// See [`NEW_BYTES`].
const CHANGE_BYTES: f64 = 4.3;

/// An update, and what is known of it.
pub struct Trial {
    update: Update,
    after: Learnt,
    bytes: Vec<u8>,
    /// What may be left out: new splats, then changes. Empty: that was chosen already.
    pub parts: Vec<Part>,
    /// Frames within which it must save the bytes that it has.
    pub horizon: f64,
    /// What it saved on each frame since, bytes.
    pub saved: Vec<f64>,
}

/// An update that is proven.
pub struct Proven {
    /// What is learnt with it.
    pub after: Learnt,
    pub bytes: Vec<u8>,
}

impl Trial {
    /// Of an update that stands on `learnt`; `None`: it is too small to be worth anything.
    pub fn new(
        learnt: &Learnt,
        update: Update,
        parts: Vec<Part>,
        horizon: f64,
    ) -> Result<Option<Trial>, UpdateError> {
        if update.splats.len() + update.removed.len() + update.changed.len() < FEWEST {
            return Ok(None);
        }
        let (mut after, mut bytes) = (learnt.clone(), Vec::new());
        after.add(&update)?;
        update.write(&mut bytes)?;
        Ok(Some(Trial { update, after, bytes, parts, horizon, saved: Vec::new() }))
    }

    /// What is learnt with the update.
    pub fn after(&self) -> &Learnt {
        &self.after
    }

    /// Its length, bytes.
    pub fn len(&self) -> usize {
        self.bytes.len()
    }

    /// Leaves out what does not save its bytes. `worths`: what each part saves per frame, bytes. `None`: too little is
    /// left.
    pub fn chosen(self, learnt: &Learnt, worths: &[f64]) -> Result<Option<Trial>, UpdateError> {
        let Trial { mut update, horizon, .. } = self;
        let (new, changes) = worths.split_at(update.splats.len());
        let pays = |worths: &[f64], cost: f64| {
            let pays: Vec<bool> = worths.iter().map(|worth| worth * horizon > cost).collect();
            pays.into_iter()
        };
        let (mut new, mut changes) = (pays(new, NEW_BYTES), pays(changes, CHANGE_BYTES));
        update.splats.retain(|_| new.next().unwrap_or(true));
        update.changed.retain(|_| changes.next().unwrap_or(true));
        Trial::new(learnt, update, Vec::new(), horizon)
    }

    pub fn proven(self) -> Proven {
        Proven { after: self.after, bytes: self.bytes }
    }
}

#[cfg(test)]
mod tests {
    use crate::prior::{LearntSplat, NewSplat, PriorId, UpdateGrid};

    use super::*;

    fn trial(count: u16) -> (Learnt, Trial) {
        let grid = UpdateGrid { origin: [0.0; 3], exponent: -8 };
        let splat = |i: u16| LearntSplat {
            position: [f32::from(i) * 0.1, 0.0, 1.0],
            log_scale: [-3.0; 3],
            rotation: [1.0, 0.0, 0.0, 0.0],
            logit: 1.0,
            colour: [0.5; 3],
        };
        let learnt = Learnt::none(PriorId(7));
        let update = Update {
            prior: learnt.prior(),
            number: 1,
            before: learnt.state(),
            grid,
            splats: (0..count).map(|i| NewSplat::nearest(&splat(i), &grid)).collect(),
            removed: Vec::new(),
            changed: Vec::new(),
            fades: Vec::new(),
            frames: [0, 9],
        };
        let parts = (0..count).map(|i| Part { splat: splat(i), new: 1.0 }).collect();
        let trial = Trial::new(&learnt, update, parts, 10.0).unwrap().expect("large enough");
        (learnt, trial)
    }

    #[test]
    fn what_does_not_save_its_bytes_is_left_out() {
        let (learnt, trial) = trial(20);
        let before = trial.len();
        // Over ten frames, 0.7 bytes per frame are more than a splat takes, 0.5 are less.
        let worths: Vec<f64> = (0..20).map(|i| if i < 12 { 0.7 } else { 0.5 }).collect();
        let chosen = trial.chosen(&learnt, &worths).unwrap().expect("twelve are left");
        assert_eq!(chosen.after().splats().len(), 12);
        assert!(chosen.len() < before && chosen.parts.is_empty());
    }

    #[test]
    fn nothing_is_left_of_an_update_whose_parts_do_harm() {
        let (learnt, trial) = trial(20);
        assert!(trial.chosen(&learnt, &[-1.0; 20]).unwrap().is_none());
    }
}
