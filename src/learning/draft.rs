//! An update while it is trained.

use std::sync::Arc;

use glam::DVec3;

use crate::prior::{Learnt, NewSplat, PriorId, Update};
use crate::render::training::{TrainingFrame, TrainingState};

use super::key_frame::KeyFrame;
use super::refine::{Course, change};
use super::worth::Part;

/// A change of a learnt splat is left out if it is smaller.
const UNCHANGED: f64 = 0.2;

/// An update that is trained.
pub struct Draft {
    /// What is learnt already and stays as it is.
    pub base: Learnt,
    /// Places of learnt splats that go, and of those that are trained again.
    pub removed: Vec<u16>,
    pub again: Vec<u16>,
    pub course: Course,
    /// What it is learnt from.
    pub frames: Vec<(Arc<KeyFrame>, TrainingFrame)>,
    /// Where the splats that are trained began: new ones, then those of `again`.
    pub places: Vec<DVec3>,
    /// Number of new splats.
    pub count: usize,
    pub step: u32,
}

impl Draft {
    /// The update that it has become, and the changes in it. `learnt`: what it stands on.
    pub fn update(
        &self,
        prior: PriorId,
        learnt: &Learnt,
        state: &TrainingState,
    ) -> (Update, Vec<Part>) {
        let grid = self.course.grid;
        let trained = self.course.splats(state, self.count + self.again.len());
        let (new, again) = trained.split_at(self.count);
        let splats = new.iter().flatten().map(|splat| NewSplat::nearest(splat, &grid)).collect();
        let (mut removed, mut changed, mut parts) = (self.removed.clone(), Vec::new(), Vec::new());
        for (place, after) in self.again.iter().zip(again) {
            match after {
                None => removed.push(*place),
                Some(after) => {
                    let new = change(&learnt.splats()[usize::from(*place)], after);
                    let sent = (new > UNCHANGED).then(|| learnt.changed_to(*place, after));
                    if let Some(sent) = sent.flatten() {
                        changed.push(sent);
                        parts.push(Part { splat: *after, new: new.min(1.0) });
                    }
                }
            }
        }
        removed.sort_unstable();
        let numbers = self.frames.iter().map(|(frame, _)| frame.number % (1 << 24));
        let frames = [numbers.clone().min().unwrap_or(0), numbers.max().unwrap_or(0)];
        let (number, before) = (learnt.number() + 1, learnt.state());
        let fades = Vec::new();
        (Update { prior, number, before, grid, splats, removed, changed, fades, frames }, parts)
    }
}
