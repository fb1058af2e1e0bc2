//! Reduces a prior to what a mission's views need: fewer splats, fitted to look like the whole prior.
//!
//! It works in rounds. A round leaves out the splats whose absence shows least in the views. It fits the rest to the
//! views' pictures. If a round costs more than the tolerance, it is taken back and tried again with fewer splats left
//! out, until there is nothing more to gain. How much a splat's absence shows is the sum over pixels of
//! `|T α (behind − colour)|²`, exact for one splat alone.
//!
//! With this rank, a fifth of the reef prior can go at a loss of 0.1 dB without any fit. If the rank is divided by the
//! pixels that a splat covers, only a tenth can go, at 0.2 dB. Time depends on the number of splats more than on their
//! pixels.

use nvsprior::geometry::CameraError;
use nvsprior::prior::{PriorError, RenderOptions, Splats};
use nvsprior::vulkan::Error as DeviceError;
use nvsprior::{Engine, Picture, Prior};

use crate::PosedPicture;
use crate::fit::{Fit, FitError};
use crate::removal::{Removal, max_needed, removals};

#[derive(Clone, Copy, Debug)]
pub struct TrimOptions {
    pub render: RenderOptions,
    /// Greatest loss, in the judge's measure.
    pub tolerance: f64,
    /// Share of the splats that the first round leaves out.
    pub share: f64,
    /// Rounds are tried with ever fewer splats down to this share.
    pub min_share: f64,
    /// Gradient steps in a round, each towards one view.
    pub steps: u32,
    /// Length of the gradient steps, in those of a new prior's.
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
            min_share: 0.02,
            steps: 330,
            pace: 1.5,
            range: None,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Round {
    /// What was left out.
    pub step: TrimStep,
    pub splats: usize,
    /// What the judge said of them.
    pub loss: f64,
    pub kept: bool,
}

/// What a round leaves out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TrimStep {
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
    type Error: From<TrimError>;

    /// What the splats lose against all of them.
    fn loss(&mut self, splats: &Splats) -> Result<f64, Self::Error>;

    /// Is called after each round, with the splats that remained.
    fn told(&mut self, round: &Round, splats: &Splats) -> Result<(), Self::Error>;

    /// Is called with the number of finished steps of a fit.
    fn fitted(&mut self, done: u32, all: u32);
}

#[derive(Debug, thiserror::Error)]
pub enum TrimError {
    #[error("no views")]
    NoViews,
    #[error("view {index}")]
    Camera { index: usize, source: CameraError },
    #[error("view {index}: its pose is not finite")]
    Pose { index: usize },
    #[error("view {index}: a picture of {width}×{height} for another camera")]
    PictureSize { index: usize, width: u32, height: u32 },
    #[error(transparent)]
    Splats(#[from] PriorError),
    #[error(transparent)]
    Fit(#[from] FitError),
    #[error(transparent)]
    Device(#[from] DeviceError),
}

/// Reduces `splats` as long as `judge` finds the loss within the tolerance. Returns all of them if it never does.
/// `views` hold the pictures to fit to. The result is the same for any number of threads.
///
/// # Errors
/// Views that cannot be used, and what the device and the judge fail with.
pub fn trim<J: Judge>(
    engine: &Engine,
    splats: &Splats,
    views: &[PosedPicture],
    options: &TrimOptions,
    judge: &mut J,
) -> Result<Splats, J::Error> {
    check_views(views)?;
    let fit = Fit::new(engine, views);
    let mut trimmer = Trimmer { best: splats.clone(), engine, views, fit, options, judge };
    trimmer.leave_out_of_range()?;
    trimmer.leave_out_unseen()?;
    trimmer.leave_out_bands()?;
    trimmer.leave_out_shares()?;
    Ok(trimmer.best)
}

fn check_views(views: &[PosedPicture]) -> Result<(), TrimError> {
    if views.is_empty() {
        return Err(TrimError::NoViews);
    }
    for (index, PosedPicture { camera, pose, picture, .. }) in views.iter().enumerate() {
        camera.check().map_err(|source| TrimError::Camera { index, source })?;
        if !pose.is_finite() {
            return Err(TrimError::Pose { index });
        }
        let &Picture { width, height, .. } = picture;
        if (width, height) != (camera.width, camera.height)
            || picture.data.len() != 3 * camera.pixels()
        {
            return Err(TrimError::PictureSize { index, width, height });
        }
    }
    Ok(())
}

struct Trimmer<'a, J> {
    /// The smallest so far that is within the tolerance.
    best: Splats,
    engine: &'a Engine,
    views: &'a [PosedPicture],
    fit: Fit<'a>,
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
        self.try_without(TrimStep::OutOfRange, &kept)
    }

    fn leave_out_unseen(&mut self) -> Result<(), J::Error> {
        let seen: Vec<bool> = self.removals()?.iter().map(|r| r.pixels > 0).collect();
        self.try_without(TrimStep::Unseen, &seen)
    }

    /// Judges the best prior without some of its splats, without a fit. Keeps the result if it is within the tolerance.
    fn try_without(&mut self, step: TrimStep, kept: &[bool]) -> Result<(), J::Error> {
        if kept.iter().all(|kept| *kept) || !kept.iter().any(|kept| *kept) {
            return Ok(());
        }
        let candidate = self.best.filtered(kept);
        self.judged(step, candidate, self.options.tolerance).map(|_| ())
    }

    /// Removes bands of spherical harmonics as long as that costs at most a quarter of the
    /// tolerance: splats are worth more.
    fn leave_out_bands(&mut self) -> Result<(), J::Error> {
        while self.best.sh_degree > 0 {
            let mut candidate = self.best.with_sh_degree(self.best.sh_degree - 1);
            self.fit(&mut candidate)?;
            if !self.judged(TrimStep::Band, candidate, 0.25 * self.options.tolerance)? {
                break;
            }
        }
        Ok(())
    }

    fn leave_out_shares(&mut self) -> Result<(), J::Error> {
        let mut share = self.options.share;
        while share >= self.options.min_share && self.best.len() > 1 {
            let removals = self.removals()?;
            let kept = max_needed(&removals, share);
            let mut candidate = self.best.filtered(&kept);
            self.fit(&mut candidate)?;
            if !self.judged(TrimStep::Share(share), candidate, self.options.tolerance)? {
                share *= 0.5;
            }
        }
        Ok(())
    }

    /// Keeps a candidate that loses no more than `limit`; whether it did.
    fn judged(&mut self, step: TrimStep, candidate: Splats, limit: f64) -> Result<bool, J::Error> {
        let loss = self.judge.loss(&candidate)?;
        let kept = loss <= limit;
        let round = Round { step, splats: candidate.len(), loss, kept };
        self.judge.told(&round, &candidate)?;
        if kept {
            self.best = candidate;
        }
        Ok(kept)
    }

    fn removals(&self) -> Result<Vec<Removal>, TrimError> {
        let places: Vec<_> = self.views.iter().map(|view| (view.camera, view.pose)).collect();
        let prior = Prior::from_splats(self.best.clone(), self.options.render)?;
        Ok(removals(self.engine, &prior, &places)?)
    }

    fn fit(&mut self, splats: &mut Splats) -> Result<(), TrimError> {
        let TrimOptions { render, steps, pace, .. } = *self.options;
        let mut done = 0;
        let mut step = || {
            done += 1;
            self.judge.fitted(done, steps);
        };
        Ok(self.fit.run(splats, &render, (steps, pace), &mut step)?)
    }
}
