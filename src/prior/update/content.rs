//! What an update holds.

use super::super::id::PriorId;
use super::UpdateError;
use super::change::Change;
use super::fade::Fade;
use super::grid::UpdateGrid;
use super::limits::{MAX_FADES, MAX_FRAME, MAX_LEARNT};
use super::places;
use super::splat::NewSplat;
use super::state::StateId;

/// A small addition to a prior, one of a chain. The [module](super) says how it is written.
#[derive(Clone, Debug, PartialEq)]
pub struct Update {
    /// The prior that the chain begins with.
    pub prior: PriorId,
    /// Its number in the chain, from 1 on.
    pub number: u16,
    /// What it stands on: the state of the prior, if it is the first one, else the state after the update before.
    pub before: StateId,
    /// Where positions are counted from.
    pub grid: UpdateGrid,
    /// The splats that it adds, at most [`MAX_LEARNT`]. Their order is that of the format, whatever it is here.
    pub splats: Vec<NewSplat>,
    /// The learnt splats that it takes back, by their place in [`Learnt::splats`](super::Learnt::splats) before it, in
    /// rising order.
    pub removed: Vec<u16>,
    /// The learnt splats that change, in rising order of their places before it, at most [`MAX_LEARNT`]. None of them
    /// is taken back.
    pub changed: Vec<Change>,
    /// Where the prior's own splats fade, at most [`MAX_FADES`].
    pub fades: Vec<Fade>,
    /// The first and the last frame that it was learnt from, modulo 2²⁴.
    pub frames: [u32; 2],
}

impl Update {
    /// The state after it: see [`StateId`]. It does not depend on the order in which the splats are here.
    pub fn state(&self) -> StateId {
        let hash = *blake3::hash(&self.content()).as_bytes();
        StateId(u32::from_le_bytes([hash[0], hash[1], hash[2], hash[3]]))
    }

    /// What the state is made of: all values, little endian, in this order.
    fn content(&self) -> Vec<u8> {
        let mut bytes = self.before.0.to_le_bytes().to_vec();
        bytes.extend(self.prior.to_bytes());
        bytes.extend(self.number.to_le_bytes());
        bytes.extend(self.grid.origin.map(f32::to_le_bytes).as_flattened());
        bytes.extend(self.grid.exponent.to_le_bytes());
        bytes.extend(self.frames.map(u32::to_le_bytes).as_flattened());
        let Update { splats, removed, changed, fades, .. } = self;
        let counts = [splats.len(), removed.len(), changed.len(), fades.len()];
        bytes.extend(counts.map(|count| (count as u32).to_le_bytes()).as_flattened());
        for splat in self.ordered() {
            bytes.extend(splat.position.map(i32::to_le_bytes).as_flattened());
            bytes.extend(splat.log_scale.map(i8::cast_unsigned));
            bytes.extend(splat.rotation.map(i8::cast_unsigned));
            bytes.push(splat.opacity.cast_unsigned());
            bytes.extend(splat.colour.map(i8::cast_unsigned));
        }
        bytes.extend(self.removed.iter().flat_map(|ordinal| ordinal.to_le_bytes()));
        for change in &self.changed {
            bytes.extend(change.ordinal.to_le_bytes());
            bytes.extend(change.position.map(i32::to_le_bytes).as_flattened());
            bytes.extend(change.log_scale.map(i8::cast_unsigned));
            bytes.extend(change.rotation.map(i8::cast_unsigned));
            bytes.push(change.opacity.cast_unsigned());
            bytes.extend(change.colour.map(i8::cast_unsigned));
        }
        for fade in &self.fades {
            bytes.extend([fade.min, fade.max].as_flattened().iter().flat_map(|v| v.to_le_bytes()));
            bytes.push(fade.factor);
        }
        bytes
    }

    /// The splats in the order of the format. Round ones have no rotation.
    pub(super) fn ordered(&self) -> Vec<NewSplat> {
        let mut splats = self.splats.clone();
        for splat in splats.iter_mut().filter(|splat| splat.is_round()) {
            splat.rotation = [0; 3];
        }
        places::sort(&mut splats, |splat| splat.position);
        splats
    }

    /// Checks all that can be checked without the updates before.
    pub fn check(&self) -> Result<(), UpdateError> {
        let refuse = |reason: String| Err(UpdateError::Content { reason });
        if let Some(fault) = self.grid.fault() {
            return refuse(format!("has a grid with {fault}"));
        }
        if self.number == 0 {
            return refuse("has the number 0; the first one of a chain has 1".into());
        }
        if self.number == 1 && self.before != self.prior.into() {
            let (before, prior) = (self.before, self.prior);
            return refuse(format!("is the first, but stands on {before}, not on prior {prior}"));
        }
        if let Some(frame) = self.frames.iter().find(|frame| **frame > MAX_FRAME) {
            return refuse(format!("has a frame number of {frame}: at most {MAX_FRAME}"));
        }
        self.check_parts()
    }

    fn check_parts(&self) -> Result<(), UpdateError> {
        if self.splats.len() > MAX_LEARNT {
            return Err(UpdateError::TooManyLearnt { count: self.splats.len() });
        }
        if self.fades.len() > MAX_FADES {
            return Err(UpdateError::TooManyFades { count: self.fades.len() });
        }
        let refuse = |part, index, reason| Err(UpdateError::Part { part, index, reason });
        for (index, splat) in self.splats.iter().enumerate() {
            if let Some(fault) = splat.fault() {
                return refuse("splat", index, fault);
            }
        }
        if let Some((index, fault)) = fault_of_ordinals(&self.removed) {
            return refuse("removed splat", index, fault);
        }
        let changed: Vec<u16> = self.changed.iter().map(|change| change.ordinal).collect();
        if let Some((index, fault)) = fault_of_ordinals(&changed) {
            return refuse("changed splat", index, fault);
        }
        for (index, change) in self.changed.iter().enumerate() {
            if self.removed.binary_search(&change.ordinal).is_ok() {
                let ordinal = change.ordinal;
                return refuse(
                    "changed splat",
                    index,
                    format!("splat {ordinal} is taken back, too"),
                );
            }
            if change.is_nothing() {
                return refuse("changed splat", index, "it stays as it is; leave it out".into());
            }
        }
        for (index, fade) in self.fades.iter().enumerate() {
            if (0..3).any(|axis| fade.min[axis] > fade.max[axis]) {
                return refuse("fade", index, "its highest cell lies below its lowest".into());
            }
        }
        Ok(())
    }
}

/// What is wrong with places of learnt splats, and with which one.
fn fault_of_ordinals(ordinals: &[u16]) -> Option<(usize, String)> {
    let beyond = ordinals.iter().position(|ordinal| usize::from(*ordinal) >= MAX_LEARNT);
    if let Some(index) = beyond {
        return Some((index, format!("{} of {MAX_LEARNT}", ordinals[index])));
    }
    let fallen = ordinals.windows(2).position(|pair| pair[0] >= pair[1])?;
    Some((fallen + 1, "they do not rise".into()))
}
