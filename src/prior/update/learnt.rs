//! What a chain of updates adds up to.

use super::super::id::PriorId;
use super::UpdateError;
use super::content::Update;
use super::fade_box::FadeBox;
use super::limits::{MAX_FADES, MAX_LEARNT};
use super::splat::LearntSplat;
use super::state::StateId;

/// What a chain of updates of one prior adds up to. Both sides of a link that added the same updates hold the same
/// bits, and the same [`state`](Learnt::state).
#[derive(Clone, Debug, PartialEq)]
pub struct Learnt {
    prior: PriorId,
    state: StateId,
    number: u16,
    splats: Vec<LearntSplat>,
    fades: Vec<FadeBox>,
}

impl Learnt {
    /// Nothing is learnt yet.
    pub fn none(prior: PriorId) -> Learnt {
        let (splats, fades) = (Vec::new(), Vec::new());
        Learnt { prior, state: prior.into(), number: 0, splats, fades }
    }

    /// Adds the next update of the chain. If it fails, nothing is changed.
    ///
    /// Fails if the update is not valid ([`Update::check`]), belongs to another prior or chain, is not the next one, or
    /// takes back what is not there; or if there would be more than [`MAX_LEARNT`] splats or [`MAX_FADES`] fades.
    pub fn add(&mut self, update: &Update) -> Result<(), UpdateError> {
        update.check()?;
        self.check_chain(update)?;
        let (removed, learnt) = (&update.removed, self.splats.len());
        if let Some(ordinal) = removed.last().filter(|last| usize::from(**last) >= learnt) {
            return Err(UpdateError::NotLearnt { ordinal: *ordinal, learnt });
        }
        let count = learnt - removed.len() + update.splats.len();
        if count > MAX_LEARNT {
            return Err(UpdateError::TooManyLearnt { count });
        }
        let fades = self.fades.len() + update.fades.len();
        if fades > MAX_FADES {
            return Err(UpdateError::TooManyFades { count: fades });
        }
        let state = update.state();
        let mut ordinals = 0..;
        self.splats.retain(|_| {
            let ordinal = ordinals.next();
            ordinal.is_none_or(|ordinal| removed.binary_search(&ordinal).is_err())
        });
        let grid = &update.grid;
        self.splats.extend(update.ordered().iter().map(|splat| splat.learnt(grid)));
        self.fades.extend(update.fades.iter().map(|fade| FadeBox::new(fade, grid)));
        (self.state, self.number) = (state, update.number);
        Ok(())
    }

    /// Checks that an update is the next one.
    fn check_chain(&self, update: &Update) -> Result<(), UpdateError> {
        let Update { prior: stated, number, before, .. } = *update;
        let (prior, state, due) = (self.prior, self.state, u32::from(self.number) + 1);
        if stated != prior {
            Err(UpdateError::Foreign { stated, prior })
        } else if u32::from(number) != due {
            Err(UpdateError::NotNext { number, before, due, state })
        } else if before != state {
            Err(UpdateError::OtherChain { number, before, state })
        } else {
            Ok(())
        }
    }

    /// The same without some learnt splats, by their places, in rising order: what an update that takes them back will
    /// make of it.
    pub(crate) fn without(&self, removed: &[u16]) -> Learnt {
        let kept = |(place, splat): (u16, &LearntSplat)| {
            removed.binary_search(&place).is_err().then_some(*splat)
        };
        Learnt { splats: (0..).zip(&self.splats).filter_map(kept).collect(), ..self.clone() }
    }

    /// The prior that the chain begins with.
    pub fn prior(&self) -> PriorId {
        self.prior
    }

    /// The state after all updates so far; without any, the prior's identity.
    pub fn state(&self) -> StateId {
        self.state
    }

    /// The number of the newest update; 0 if there is none.
    pub fn number(&self) -> u16 {
        self.number
    }

    /// The learnt splats: those of earlier updates first, those of one update in the order of the format.
    pub fn splats(&self) -> &[LearntSplat] {
        &self.splats
    }

    /// How many fades there are.
    pub fn fades(&self) -> usize {
        self.fades.len()
    }

    /// What the opacity of one of the prior's own splats is multiplied by, 0 to 1, by the position of its centre.
    pub fn fade_of(&self, position: [f32; 3]) -> f32 {
        self.fades.iter().map(|fade| fade.at(position)).product()
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::id::PriorId;
    use super::super::tests::sample;
    use super::super::{Fade, NewSplat, StateId, UpdateGrid};
    use super::*;

    /// Three updates of 4, 3 and 2 splats; the second takes back splats 0 and 2, the third splats 1 and 4.
    fn chain() -> [Update; 3] {
        let mut chain = [sample(1, 4), sample(2, 3), sample(3, 2)];
        chain[1].removed = vec![0, 2];
        chain[2].removed = vec![1, 4];
        for index in 1..3 {
            chain[index].before = chain[index - 1].state();
        }
        chain
    }

    #[test]
    fn a_chain_adds_up() {
        let chain = chain();
        let mut learnt = Learnt::none(PriorId(7));
        assert_eq!((learnt.state(), learnt.number()), (StateId(7), 0));
        for update in &chain {
            learnt.add(update).unwrap();
            assert_eq!((learnt.state(), learnt.number()), (update.state(), update.number));
        }
        let of =
            |update: usize, index: usize| chain[update].splats[index].learnt(&chain[update].grid);
        // After the second: 0/1, 0/3, 1/0, 1/1, 1/2. The third takes back 0/3 and 1/2.
        assert_eq!(learnt.splats(), [of(0, 1), of(1, 0), of(1, 1), of(2, 0), of(2, 1)]);
    }

    #[test]
    fn the_order_of_splats_in_memory_does_not_count() {
        let [first, ..] = chain();
        let mut turned = first.clone();
        turned.splats.reverse();
        let mut both = [Learnt::none(PriorId(7)), Learnt::none(PriorId(7))];
        both[0].add(&first).unwrap();
        both[1].add(&turned).unwrap();
        assert_eq!(both[0], both[1]);
    }

    #[test]
    fn what_does_not_fit_changes_nothing_and_says_why() {
        let [first, second, third] = chain();
        let mut learnt = Learnt::none(PriorId(7));
        let refuse = |learnt: &mut Learnt, update: &Update| {
            let before = learnt.clone();
            let error = learnt.add(update).unwrap_err();
            assert_eq!(*learnt, before);
            error.to_string()
        };
        let error = refuse(&mut learnt, &second);
        assert!(
            error.ends_with("update 1 is due, on state 00000007; add update 1 first"),
            "{error}"
        );
        let error = refuse(&mut learnt, &third);
        assert!(error.ends_with("; add updates 1 to 2 first"), "{error}");
        learnt.add(&first).unwrap();
        let error = refuse(&mut learnt, &first);
        assert!(error.ends_with("; it is there already, or belongs to another dive"), "{error}");
        let other = Update { before: StateId(9), ..second.clone() };
        let error = refuse(&mut learnt, &other);
        assert!(error.starts_with("update 2 stands on state 00000009, but the updates before it"));
        let foreign = Update { prior: PriorId(8), ..second.clone() };
        let error = refuse(&mut learnt, &foreign);
        assert!(error.starts_with("an update of prior 00000008, not of prior 00000007"), "{error}");
        let far = Update { removed: vec![1, 4], ..second.clone() };
        let error = refuse(&mut learnt, &far);
        assert!(error.starts_with("takes back splat 4 of 4 learnt ones"), "{error}");
        let broken = Update { removed: vec![1, 1], ..second.clone() };
        assert!(refuse(&mut learnt, &broken).contains("they do not rise"));
        let many = Update { splats: vec![NewSplat::default(); 4095], ..second.clone() };
        let error = refuse(&mut learnt, &many);
        assert!(error.starts_with("4097 learnt splats: at most 4096"), "{error}");
        let many = Update { fades: vec![Fade::default(); 256], ..second.clone() };
        let error = refuse(&mut learnt, &many);
        assert!(error.starts_with("257 fades in all updates: at most 256"), "{error}");
        learnt.add(&second).unwrap();
    }

    #[test]
    fn every_value_counts_for_the_state() {
        let update = sample(2, 3);
        let changes: [fn(&mut Update); 13] = [
            |u| u.prior.0 += 1,
            |u| u.number += 1,
            |u| u.before.0 += 1,
            |u| u.grid.origin[2] += 1.0,
            |u| u.grid.exponent += 1,
            |u| u.splats[2].position[1] += 1,
            |u| u.splats[1].log_scale[0] += 1,
            |u| u.splats[0].rotation[2] += 1,
            |u| u.splats[2].opacity -= 1,
            |u| u.splats[1].colour[1] += 1,
            |u| u.removed[1] += 1,
            |u| u.fades[0].factor += 1,
            |u| u.frames[0] += 1,
        ];
        let mut states: Vec<StateId> = changes
            .iter()
            .map(|change| {
                let mut other = update.clone();
                change(&mut other);
                other.state()
            })
            .collect();
        states.push(update.state());
        states.sort_by_key(|state| state.0);
        states.dedup();
        assert_eq!(states.len(), 14);
    }

    #[test]
    fn fades_multiply() {
        let grid = UpdateGrid { origin: [0.0; 3], exponent: 0 };
        let fades = vec![
            grid.fade([0.0; 3], [20.0; 3], 51),
            grid.fade([16.0, 0.0, 0.0], [40.0; 3], 102),
            grid.fade([32.0; 3], [40.0; 3], 0),
        ];
        let update = Update { grid, fades, ..sample(1, 0) };
        let mut learnt = Learnt::none(PriorId(7));
        learnt.add(&update).unwrap();
        let at = |x: f32| learnt.fade_of([x, x, x]);
        assert_eq!(
            [at(-0.1), at(1.0), at(17.0), at(25.0), at(39.0), at(48.0)],
            [1.0, 0.2, 0.2 * (102.0 / 255.0), 102.0 / 255.0, 0.0, 1.0]
        );
    }
}
