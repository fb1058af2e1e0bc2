//! How a search goes through the pyramid: which levels, and how many evaluations.

use crate::search::{Placement, Program, STARTS};

/// How a search goes through the pyramid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Schedule {
    /// Level at which each start is first evaluated. A frame that follows another begins here if that one was followed
    /// easily, else higher, up to `far_level`.
    pub first_level: usize,
    /// Level down to which each start is followed by itself. Below it only the best goes on.
    pub follow_level: usize,
    /// Levels to visit, one bit per level; level 0 is always visited.
    pub levels: u32,
    /// Levels of which an evaluation draws only some rows of tiles, one bit per level: see docs/decisions.md, 40. Final
    /// pictures are always whole.
    pub sparse: u32,
    /// Most renders of one start at one level while starts are compared; 1: starts are only scored.
    pub follow_renders: u32,
    /// Most renders of a coarse level.
    pub coarse_renders: u32,
    /// Most renders at full resolution.
    pub renders: u32,
    /// If the first step promises to lower the error by more than this share, the start is far off.
    /// The search then goes on at `far_level`, if that is above the first level.
    pub near: f32,
    /// See `near`.
    pub far_level: usize,
    /// If a coarse level's step is expected to lower the error by less than this share, it is taken
    /// without an evaluation and ends the level. The next level evaluates it.
    pub coarse_leap: f32,
    /// As `coarse_leap`, at full resolution: the final picture shows the outcome.
    pub leap: f32,
    /// A coarse level is done if the next step is expected to lower the error by less than this share.
    pub coarse_tolerance: f32,
    /// As `coarse_tolerance`, at full resolution; 1e-3 is 0.004 dB.
    pub tolerance: f32,
}

impl Schedule {
    /// The program that the device runs on a pyramid of `levels` levels, from the first eight of `starts`. `profile`:
    /// how the pose is coded, see [`Tracker::set_profile`](super::Tracker::set_profile).
    pub fn program(
        &self,
        levels: usize,
        starts: impl IntoIterator<Item = Placement>,
        damping: f32,
        profile: u32,
    ) -> Program {
        let last = levels - 1;
        let mut placements = [Placement::default(); STARTS];
        let mut count = 0;
        for (to, start) in placements.iter_mut().zip(starts) {
            *to = start;
            count += 1;
        }
        let first_level = self.first_level.min(last);
        Program {
            starts: placements,
            count,
            first_level: first_level as u32,
            follow_level: self.follow_level.min(first_level) as u32,
            levels: self.levels,
            sparse: self.sparse,
            follow_renders: self.follow_renders,
            coarse_renders: self.coarse_renders,
            renders: self.renders,
            near: self.near,
            far_level: self.far_level.min(last) as u32,
            coarse_leap: self.coarse_leap,
            leap: self.leap,
            coarse_tolerance: self.coarse_tolerance,
            tolerance: self.tolerance,
            damping,
            profile,
        }
    }
}
