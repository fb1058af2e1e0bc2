//! What a chain of updates adds up to.

use super::super::id::PriorId;
use super::UpdateError;
use super::change::Change;
use super::content::Update;
use super::fade_box::FadeBox;
use super::grid::UpdateGrid;
use super::limits::{MAX_FADES, MAX_LEARNT};
use super::splat::{LearntSplat, NewSplat};
use super::state::StateId;

/// What a chain of updates of one prior adds up to. Both sides of a link that added the same updates hold the same
/// bits, and the same [`state`](Learnt::state).
#[derive(Clone, Debug, PartialEq)]
pub struct Learnt {
    prior: PriorId,
    state: StateId,
    number: u16,
    splats: Vec<LearntSplat>,
    /// The same in steps.
    steps: Vec<Steps>,
    fades: Vec<FadeBox>,
}

/// A learnt splat in steps, so that changes of it are exact.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Steps {
    splat: NewSplat,
    grid: UpdateGrid,
}

impl Learnt {
    /// Nothing is learnt yet.
    pub fn none(prior: PriorId) -> Learnt {
        let (splats, steps, fades) = (Vec::new(), Vec::new(), Vec::new());
        Learnt { prior, state: prior.into(), number: 0, splats, steps, fades }
    }

    /// Adds the next update of the chain. If it fails, nothing is changed.
    ///
    /// Fails if the update is not valid ([`Update::check`]), belongs to another prior or chain, is not the next one, or
    /// takes back or changes what is not there; if a change leads to what no splat can be; or if there would be more
    /// than [`MAX_LEARNT`] splats or [`MAX_FADES`] fades.
    pub fn add(&mut self, update: &Update) -> Result<(), UpdateError> {
        update.check()?;
        self.check_chain(update)?;
        self.check_places(update)?;
        let count = self.splats.len() - update.removed.len() + update.splats.len();
        if count > MAX_LEARNT {
            return Err(UpdateError::TooManyLearnt { count });
        }
        let fades = self.fades.len() + update.fades.len();
        if fades > MAX_FADES {
            return Err(UpdateError::TooManyFades { count: fades });
        }
        let changed = self.changed(&update.changed)?;
        for (change, splat) in update.changed.iter().zip(changed) {
            let place = usize::from(change.ordinal);
            self.steps[place].splat = splat;
            self.splats[place] = splat.learnt(&self.steps[place].grid);
        }
        self.splats = without(&self.splats, &update.removed);
        self.steps = without(&self.steps, &update.removed);
        let grid = update.grid;
        for splat in update.ordered() {
            self.splats.push(splat.learnt(&grid));
            self.steps.push(Steps { splat, grid });
        }
        self.fades.extend(update.fades.iter().map(|fade| FadeBox::new(fade, &grid)));
        (self.state, self.number) = (update.state(), update.number);
        Ok(())
    }

    /// Checks that what an update takes back or changes is there.
    fn check_places(&self, update: &Update) -> Result<(), UpdateError> {
        let learnt = self.splats.len();
        let check = |does, last: Option<u16>| match last {
            Some(ordinal) if usize::from(ordinal) >= learnt => {
                Err(UpdateError::NotLearnt { does, ordinal, learnt })
            }
            _ => Ok(()),
        };
        check("takes back", update.removed.last().copied())?;
        check("changes", update.changed.last().map(|change| change.ordinal))
    }

    /// What splats are after changes, in the order of the changes.
    fn changed(&self, changes: &[Change]) -> Result<Vec<NewSplat>, UpdateError> {
        let splat = |change: &Change| {
            let ordinal = change.ordinal;
            let splat = change.applied(&self.steps[usize::from(ordinal)].splat);
            splat.map_err(|reason| UpdateError::Change { ordinal, reason })
        };
        changes.iter().map(splat).collect()
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
    #[cfg(any(test, feature = "training"))]
    pub(crate) fn without(&self, removed: &[u16]) -> Learnt {
        let splats = without(&self.splats, removed);
        Learnt { splats, steps: without(&self.steps, removed), ..self.clone() }
    }

    /// The change by which the learnt splat `ordinal` comes nearest to `wanted`: it keeps the names of its axes, and
    /// its grid. `None` if it stays as it is, or if there is no such splat.
    pub fn changed_to(&self, ordinal: u16, wanted: &LearntSplat) -> Option<Change> {
        let Steps { splat, grid } = self.steps.get(usize::from(ordinal))?;
        Change::between(ordinal, splat, &NewSplat::as_named(wanted, grid))
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

/// Those of a list that stay, if those at some places, in rising order, go.
fn without<T: Copy>(all: &[T], removed: &[u16]) -> Vec<T> {
    let stays = |(place, item): (u16, &T)| removed.binary_search(&place).is_err().then_some(*item);
    (0..).zip(all).filter_map(stays).collect()
}

#[cfg(test)]
mod tests {
    use super::super::super::id::PriorId;
    use super::super::tests::sample;
    use super::super::{Fade, StateId};
    use super::*;

    /// Changes numbers of all kinds.
    fn change(ordinal: u16) -> Change {
        let position = [9, -1, i32::from(ordinal)];
        let (log_scale, rotation) = ([1, 0, -1], [0, 1, -1]);
        Change { ordinal, position, log_scale, rotation, opacity: -1, colour: [-1, 1, 2] }
    }

    /// Three updates of 4, 3 and 2 splats; the second takes back splats 0 and 2 and changes splat 3, the third takes
    /// back splats 1 and 4, and changes splats 0, 2 and 3.
    fn chain() -> [Update; 3] {
        let mut chain = [sample(1, 4), sample(2, 3), sample(3, 2)];
        chain[1].removed = vec![0, 2];
        chain[2].removed = vec![1, 4];
        chain[1].changed = vec![change(3)];
        chain[2].changed = [0, 2, 3].map(change).to_vec();
        // What is changed must stay within the range.
        for splat in chain.iter_mut().flat_map(|update| &mut update.splats) {
            splat.rotation = splat.rotation.map(|v| v.clamp(-9, 9));
            splat.opacity = splat.opacity.max(-1);
        }
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
        let of = |update: usize, index: usize, changes: &[Change]| {
            let Update { splats, grid, .. } = &chain[update];
            let apply = |splat, change: &Change| change.applied(&splat).unwrap();
            changes.iter().fold(splats[index], apply).learnt(grid)
        };
        // After the second: 0/1, 0/3, 1/0, 1/1, 1/2. The third takes back 0/3 and 1/2.
        let expected = [
            of(0, 1, &[change(0)]),
            of(1, 0, &[change(2)]),
            of(1, 1, &[change(3)]),
            of(2, 0, &[]),
            of(2, 1, &[]),
        ];
        assert_eq!(learnt.splats(), expected);
        let mut earlier = Learnt::none(PriorId(7));
        chain[..2].iter().for_each(|update| earlier.add(update).unwrap());
        assert_eq!(earlier.splats()[1], of(0, 3, &[change(3)]));
    }

    #[test]
    fn what_stays_can_be_changed_after_others_went() {
        let [first, second, third] = chain();
        let mut learnt = Learnt::none(PriorId(7));
        learnt.add(&first).unwrap();
        let less = learnt.without(&second.removed);
        assert_eq!(less.splats(), [learnt.splats()[1], learnt.splats()[3]]);
        let wanted = first.splats[0].learnt(&first.grid);
        let (a, b) = (less.changed_to(1, &wanted), learnt.changed_to(3, &wanted));
        assert_eq!(a, b.map(|change| Change { ordinal: 1, ..change }));
        learnt.add(&second).unwrap();
        learnt.add(&third).unwrap();
        assert_eq!(learnt.splats().len(), learnt.steps.len());
    }

    /// A learnt splat with some noise, and with the opposite quaternion if `turned`.
    fn near(splat: &LearntSplat, noise: f32, turned: bool) -> LearntSplat {
        let sign = if turned { -1.0 } else { 1.0 };
        LearntSplat {
            position: splat.position.map(|v| v + noise / 64.0),
            log_scale: splat.log_scale.map(|v| v - noise * 0.25),
            rotation: splat.rotation.map(|v| sign * v),
            logit: splat.logit + noise * 0.8,
            colour: splat.colour.map(|v| v + noise * 0.12),
        }
    }

    #[test]
    fn the_nearest_change_keeps_the_names_of_the_axes() {
        let mut first = sample(1, 40);
        // Round across one axis, and in all directions: turns that show nothing stay as they are.
        first.splats[1].log_scale = [-12, -12, -9];
        first.splats[2] = NewSplat { log_scale: [-12; 3], rotation: [0; 3], ..first.splats[2] };
        first.splats = first.ordered();
        let mut learnt = Learnt::none(PriorId(7));
        learnt.add(&first).unwrap();
        for ordinal in 0..40 {
            let before = learnt.splats()[usize::from(ordinal)];
            for turned in [false, true] {
                assert_eq!(learnt.changed_to(ordinal, &near(&before, 0.4, turned)), None);
                let wanted = near(&before, 1.0, turned);
                let change = learnt.changed_to(ordinal, &wanted).unwrap();
                // The sample's opacities end two steps below the most.
                let expected = Change {
                    ordinal,
                    position: [1; 3],
                    log_scale: [-1; 3],
                    rotation: [0; 3],
                    opacity: 1,
                    colour: [1; 3],
                };
                assert_eq!(change, expected);
            }
        }
        assert_eq!(learnt.changed_to(40, &learnt.splats()[0]), None, "there is none");
    }

    #[test]
    fn changes_beyond_the_range_change_nothing_and_say_which() {
        let [first, second, _] = chain();
        let mut learnt = Learnt::none(PriorId(7));
        learnt.add(&first).unwrap();
        let before = learnt.clone();
        let mut refuse = |by: Change| {
            let update = Update { changed: vec![change(1), by], ..second.clone() };
            let error = learnt.add(&update).unwrap_err();
            assert_eq!(learnt, before);
            error.to_string()
        };
        let none = Change { ordinal: 3, ..Change::default() };
        let error = refuse(Change { opacity: 20, ..none });
        assert!(
            error.starts_with("changes learnt splat 3 beyond what a splat can be: opacity of ")
        );
        let error = refuse(Change { rotation: [0, 0, 30], ..none });
        assert!(error.contains("rotation of "), "{error}");
        let error = refuse(Change { ordinal: 4, ..change(3) });
        assert!(error.starts_with("changes splat 4 of 4 learnt ones"), "{error}");
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
        let changes: [fn(&mut Update); 19] = [
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
            |u| u.removed[2] += 1,
            |u| u.changed[1].ordinal += 1,
            |u| u.changed[1].position[2] += 1,
            |u| u.changed[1].log_scale[1] += 1,
            |u| u.changed[1].rotation[0] += 1,
            |u| u.changed[1].opacity += 1,
            |u| u.changed[1].colour[2] += 1,
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
        assert_eq!(states.len(), 20);
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
