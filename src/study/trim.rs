//! Reducing a prior to what a mission's views need: fewer splats, fitted to look like all of them.
//!
//! In rounds: the splats whose absence the views would show least are left out, and what remains is
//! fitted to the pictures of the whole prior, colours by least squares, then everything by gradient
//! steps. A round that costs more than the tolerance is taken back and tried with fewer splats, until
//! there is nothing more to gain. What a splat's absence shows is the sum over pixels of
//! `|T α (behind − colour)|²`, exact for one splat alone.

use crate::mapping::fit::{self, sum_over};
use crate::mapping::project::Geometry;
use crate::mapping::raster::Projection;
pub use crate::mapping::raster::Removal;
use crate::mapping::{self, MappingError, MappingOptions, View, harmonics, train};
use crate::prior::{RenderOptions, Splats};
use crate::{Camera, Pose};

/// How a prior is reduced.
#[derive(Clone, Copy, Debug)]
pub struct TrimOptions {
    /// How the prior is rendered.
    pub render: RenderOptions,
    /// Greatest loss, in the judge's measure.
    pub tolerance: f64,
    /// Share of the splats that the first round leaves out.
    pub share: f64,
    /// Rounds are tried with ever fewer splats down to this share.
    pub least_share: f64,
    /// Steps of the colours' solver in a round; each rasterises every view.
    pub sweeps: u32,
    /// Gradient steps in a round; each rasterises two views.
    pub steps: u32,
    /// Length of the gradient steps, as a share of those that make a prior from nothing.
    pub pace: f32,
    /// Splats farther than this from all cameras are left out, the prior's unit.
    pub range: Option<f64>,
}

impl TrimOptions {
    /// The default way, for a prior that is rendered so.
    pub fn new(render: RenderOptions, tolerance: f64) -> TrimOptions {
        TrimOptions {
            render,
            tolerance,
            share: 0.2,
            least_share: 0.02,
            sweeps: 2,
            steps: 80,
            pace: 0.15,
            range: None,
        }
    }
}

/// What was tried.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Round {
    /// What was left out.
    pub step: Step,
    /// Splats that remained.
    pub splats: usize,
    /// What the judge said of them.
    pub loss: f64,
    /// Whether it was kept.
    pub kept: bool,
}

/// What a round leaves out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Step {
    /// Splats that no view shows.
    Unseen,
    /// Splats out of range of all cameras.
    OutOfRange,
    /// The highest band of the spherical harmonics.
    Band,
    /// This share of the splats.
    Share(f64),
}

/// Who says what a reduced prior loses, and hears how it goes.
pub trait Judge {
    /// What judging fails with.
    type Error: From<MappingError>;

    /// What the splats lose against all of them.
    fn loss(&mut self, splats: &Splats) -> Result<f64, Self::Error>;

    /// Hears of a round that is over.
    fn told(&mut self, round: &Round);

    /// Hears that so many steps of a fit are done.
    fn fitted(&mut self, done: u32, all: u32);
}

/// Reduces `splats` as far as `judge` finds their loss within the tolerance; all of them where it
/// never does. `views` hold pictures of the whole prior. The result is the same for any number of
/// threads.
///
/// # Errors
/// Views that cannot be used, and what the judge fails with.
pub fn trim<J: Judge>(
    splats: &Splats,
    views: &[View],
    options: &TrimOptions,
    judge: &mut J,
) -> Result<Splats, J::Error> {
    mapping::check_views(views)?;
    let mut trimmer = Trimmer { best: splats.clone(), views, options, judge };
    trimmer.leave_out_of_range()?;
    trimmer.leave_out_unseen()?;
    trimmer.leave_out_bands()?;
    trimmer.leave_out_shares()?;
    Ok(trimmer.best)
}

/// What leaving out each splat alone would do to the pictures at some places.
pub fn removals(
    splats: &Splats,
    render: &RenderOptions,
    places: &[(Camera, Pose)],
) -> Vec<Removal> {
    let geometry = Geometry::of(splats);
    let background = render.background.into();
    sum_over(places, vec![Removal::default(); splats.len()], |(camera, pose), sums| {
        let colours = harmonics::colours(splats, pose.centre().as_vec3());
        Projection::new(&geometry, camera, pose, render).add_removals(&colours, background, sums);
    })
}

/// Whether each splat stays where a share of them goes: those that show least. One stays at least.
pub fn most_needed(removals: &[Removal], share: f64) -> Vec<bool> {
    let mut order: Vec<usize> = (0..removals.len()).collect();
    let error = |i: &usize| removals[*i].error;
    // Of equals those go first that lie behind.
    order.sort_by(|a, b| error(a).total_cmp(&error(b)).then(b.cmp(a)));
    let most = removals.len().saturating_sub(1);
    let gone = ((share * removals.len() as f64).ceil() as usize).min(most);
    let mut kept = vec![true; removals.len()];
    order[..gone].iter().for_each(|i| kept[*i] = false);
    kept
}

struct Trimmer<'a, J> {
    /// The smallest so far that is within the tolerance.
    best: Splats,
    views: &'a [View],
    options: &'a TrimOptions,
    judge: &'a mut J,
}

impl<J: Judge> Trimmer<'_, J> {
    fn leave_out_of_range(&mut self) -> Result<(), J::Error> {
        let Some(range) = self.options.range else { return Ok(()) };
        let centres: Vec<_> = self.views.iter().map(|view| view.pose.centre()).collect();
        let near = |p: &[f32; 3]| {
            let p = glam::DVec3::from(p.map(f64::from));
            centres.iter().any(|c| p.distance_squared(*c) <= range * range)
        };
        let kept: Vec<bool> = self.best.positions.iter().map(near).collect();
        self.try_without(Step::OutOfRange, &kept)
    }

    fn leave_out_unseen(&mut self) -> Result<(), J::Error> {
        let seen: Vec<bool> = self.removals().iter().map(|r| r.pixels > 0.0).collect();
        self.try_without(Step::Unseen, &seen)
    }

    /// Judges the best without some splats, as they are; kept where it is within the tolerance.
    fn try_without(&mut self, step: Step, kept: &[bool]) -> Result<(), J::Error> {
        if kept.iter().all(|kept| *kept) || !kept.iter().any(|kept| *kept) {
            return Ok(());
        }
        let candidate = self.best.filtered(kept);
        self.judged(step, candidate, self.options.tolerance).map(|_| ())
    }

    /// Takes away bands of spherical harmonics for as long as that is nearly free: a quarter of the
    /// tolerance, since splats are worth more.
    fn leave_out_bands(&mut self) -> Result<(), J::Error> {
        while self.best.sh_degree > 0 {
            let mut candidate = self.best.with_sh_degree(self.best.sh_degree - 1);
            self.fit(&mut candidate);
            if !self.judged(Step::Band, candidate, 0.25 * self.options.tolerance)? {
                break;
            }
        }
        Ok(())
    }

    fn leave_out_shares(&mut self) -> Result<(), J::Error> {
        let mut share = self.options.share;
        while share >= self.options.least_share && self.best.len() > 1 {
            let removals = self.removals();
            let kept = most_needed(&removals, share);
            let mut candidate = self.best.filtered(&kept);
            self.fit(&mut candidate);
            if !self.judged(Step::Share(share), candidate, self.options.tolerance)? {
                share *= 0.5;
            }
        }
        Ok(())
    }

    /// Keeps a candidate that loses no more than `limit`; whether it did.
    fn judged(&mut self, step: Step, candidate: Splats, limit: f64) -> Result<bool, J::Error> {
        let loss = self.judge.loss(&candidate)?;
        let kept = loss <= limit;
        self.judge.told(&Round { step, splats: candidate.len(), loss, kept });
        if kept {
            self.best = candidate;
        }
        Ok(kept)
    }

    fn removals(&self) -> Vec<Removal> {
        let places: Vec<_> = self.views.iter().map(|view| (view.camera, view.pose)).collect();
        removals(&self.best, &self.options.render, &places)
    }

    /// Fits splats to the pictures of the whole prior.
    fn fit(&mut self, splats: &mut Splats) {
        let TrimOptions { render, sweeps, steps, pace, .. } = *self.options;
        let options = MappingOptions { render, sweeps, steps, ..MappingOptions::default() };
        let mut done = 0;
        let mut step = || {
            done += 1;
            self.judge.fitted(done, sweeps + steps);
        };
        fit::correct_colours(splats, self.views, &options, &mut step);
        train::train(splats, self.views, &options, pace, &mut step);
    }
}
