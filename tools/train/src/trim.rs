//! Reduces a prior to what a mission's views need: fewer splats, fitted to look like the whole prior.
//!
//! It works in rounds. A round leaves out the splats whose absence shows least in the views. It fits the rest to the
//! views' pictures: everything by gradient steps, then colours by least squares. If a round costs more than the
//! tolerance, it is taken back and tried again with fewer splats left out, until there is nothing more to gain. How
//! much a splat's absence shows is the sum over pixels of `|T α (behind − colour)|²`, exact for one splat alone.
//!
//! With this rank, a fifth of the reef prior can go at a loss of 0.1 dB without any fit. If the rank is divided by the
//! pixels that a splat covers, only a tenth can go, at 0.2 dB. Time depends on the number of splats more than on their
//! pixels.

use crate::PosedPicture;
pub use crate::refit::ViewError;
use crate::refit::fit::sum_over;
use crate::refit::project::Geometry;
use crate::refit::raster::Projection;
pub use crate::refit::raster::Removal;
use crate::refit::{RefitOptions, check_views, harmonics, refit};
use nvsprior::prior::{RenderOptions, Splats};
use nvsprior::{Camera, Pose};

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
    /// Length of the gradient steps, as a share of that for a new prior.
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
    type Error: From<ViewError>;

    /// What the splats lose against all of them.
    fn loss(&mut self, splats: &Splats) -> Result<f64, Self::Error>;

    /// Is called after each round, with the splats that remained.
    fn told(&mut self, round: &Round, splats: &Splats) -> Result<(), Self::Error>;

    /// Is called with the number of finished steps of a fit.
    fn fitted(&mut self, done: u32, all: u32);
}

/// Reduces `splats` as long as `judge` finds the loss within the tolerance. Returns all of them if
/// it never does. `views` hold the pictures to fit to. The result is the same for any number of
/// threads.
///
/// # Errors
/// Views that cannot be used, and what the judge fails with.
pub fn trim<J: Judge>(
    splats: &Splats,
    views: &[PosedPicture],
    options: &TrimOptions,
    judge: &mut J,
) -> Result<Splats, J::Error> {
    check_views(views)?;
    let mut trimmer = Trimmer { best: splats.clone(), views, options, judge };
    trimmer.leave_out_of_range()?;
    trimmer.leave_out_unseen()?;
    trimmer.leave_out_bands()?;
    trimmer.leave_out_shares()?;
    Ok(trimmer.best)
}

/// For each splat, how the pictures at some places would change without it.
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

/// Which splats stay if the share `share` of them goes, those that show least first. At least one stays.
pub fn most_needed(removals: &[Removal], share: f64) -> Vec<bool> {
    let mut order: Vec<usize> = (0..removals.len()).collect();
    let error = |i: &usize| removals[*i].error;
    // Of equal splats the later ones go first.
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
    views: &'a [PosedPicture],
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

    /// Judges the best prior without some of its splats, without a fit. Keeps the result if it is within the tolerance.
    fn try_without(&mut self, step: Step, kept: &[bool]) -> Result<(), J::Error> {
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
        let round = Round { step, splats: candidate.len(), loss, kept };
        self.judge.told(&round, &candidate)?;
        if kept {
            self.best = candidate;
        }
        Ok(kept)
    }

    fn removals(&self) -> Vec<Removal> {
        let places: Vec<_> = self.views.iter().map(|view| (view.camera, view.pose)).collect();
        removals(&self.best, &self.options.render, &places)
    }

    /// Fits splats to the views.
    fn fit(&mut self, splats: &mut Splats) {
        let TrimOptions { render, sweeps, steps, pace, .. } = *self.options;
        let options = RefitOptions { render, sweeps, steps, pace };
        let mut done = 0;
        let mut step = || {
            done += 1;
            self.judge.fitted(done, sweeps + steps);
        };
        refit(splats, self.views, &options, &mut step);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::refit::tests::preview;
    use nvsprior::Picture;

    const CAMERA: Camera = Camera { width: 48, height: 40, fx: 40.0, fy: 40.0, cx: 24.0, cy: 20.0 };
    const RENDER: RenderOptions = RenderOptions::INRIA;

    /// Splats about z = 3, some of them beside the picture.
    fn cloud(count: usize, sh_degree: u32) -> Splats {
        let wave = |i: usize, f: f32| (i as f32 * f + 0.7).sin();
        let each = |f: &dyn Fn(usize) -> [f32; 3]| (0..count).map(f).collect::<Vec<_>>();
        let mut splats = Splats {
            positions: each(&|i| [2.4 * wave(i, 1.7), 1.4 * wave(i, 2.9), 3.0 + wave(i, 0.3)]),
            log_scales: each(&|i| [-2.2 + 0.4 * wave(i, 0.7), -2.0, -2.6]),
            rotations: (0..count).map(|i| [1.0, wave(i, 0.2), wave(i, 0.9), 0.3]).collect(),
            opacity_logits: (0..count).map(|i| 1.0 + 2.0 * wave(i, 1.3)).collect(),
            sh: Vec::new(),
            sh_degree,
        };
        splats.sh = (0..count * splats.sh_stride()).map(|i| 0.3 * wave(i, 0.77)).collect();
        splats
    }

    fn poses() -> Vec<Pose> {
        let step = |t: f64| [0.1 * t, -0.05 * t, 0.0, 0.02 * t, 0.03 * t, 0.0];
        (0..3).map(|t| Pose::exp(&step(f64::from(t)))).collect()
    }

    fn pictures(splats: &Splats) -> Vec<Picture> {
        poses().iter().map(|pose| preview(splats, &RENDER, &CAMERA, pose)).collect()
    }

    fn views(splats: &Splats) -> Vec<PosedPicture> {
        let all = std::iter::zip(poses(), pictures(splats));
        all.map(|(pose, picture)| PosedPicture::new(CAMERA, pose, picture)).collect()
    }

    /// Finds how far pictures are below a PSNR.
    struct Floor {
        whole: Vec<Picture>,
        psnr: f64,
        rounds: Vec<Round>,
    }

    impl Judge for Floor {
        type Error = ViewError;

        fn loss(&mut self, splats: &Splats) -> Result<f64, ViewError> {
            let all = std::iter::zip(pictures(splats), &self.whole);
            Ok(self.psnr - all.map(|(a, b)| a.psnr(b)).fold(f64::INFINITY, f64::min))
        }

        fn told(&mut self, round: &Round, splats: &Splats) -> Result<(), ViewError> {
            assert_eq!(round.splats, splats.len());
            self.rounds.push(*round);
            Ok(())
        }

        fn fitted(&mut self, done: u32, all: u32) {
            assert!(done <= all);
        }
    }

    fn trimmed(splats: &Splats, psnr: f64, change: fn(&mut TrimOptions)) -> (Splats, Vec<Round>) {
        let mut floor = Floor { whole: pictures(splats), psnr, rounds: Vec::new() };
        let mut options = TrimOptions { steps: 6, ..TrimOptions::new(RENDER, 0.0) };
        change(&mut options);
        let kept = trim(splats, &views(splats), &options, &mut floor).unwrap();
        (kept, floor.rounds)
    }

    #[test]
    fn removals_are_what_leaving_one_splat_out_does() {
        let splats = cloud(60, 1);
        let place = [(CAMERA, poses()[1])];
        let render = RenderOptions { background: [0.1, 0.5, 0.9], ..RENDER };
        let picture = |splats: &Splats| {
            let mut picture = vec![glam::Vec3::ZERO; CAMERA.pixels()];
            let colours = harmonics::colours(splats, place[0].1.centre().as_vec3());
            let projection = Projection::new(&Geometry::of(splats), &CAMERA, &place[0].1, &render);
            projection.render(&colours, render.background.into(), |i, value| picture[i] = value);
            picture
        };
        let (whole, removals) = (picture(&splats), removals(&splats, &render, &place));
        for (i, removal) in removals.iter().enumerate() {
            let kept: Vec<bool> = (0..60).map(|k| k != i).collect();
            let changes = std::iter::zip(&whole, picture(&splats.filtered(&kept)));
            let changes: Vec<f32> = changes.map(|(a, b)| (*a - b).length_squared()).collect();
            let error: f32 = changes.iter().sum();
            assert!(
                (removal.error - error).abs() <= 1e-3 * error + 1e-7,
                "{i}: {removal:?} {error}"
            );
            assert_eq!(removal.pixels > 0.0, error > 0.0, "{i}");
        }
    }

    #[test]
    fn splats_go_until_the_floor_and_no_further() {
        let splats = cloud(300, 1);
        let (kept, rounds) = trimmed(&splats, 38.0, |_| ());
        assert!(kept.len() < 200, "{} splats, {rounds:?}", kept.len());
        let worst = |splats: &Splats| {
            let all = std::iter::zip(pictures(splats), pictures(&cloud(300, 1)));
            all.map(|(a, b)| a.psnr(&b)).fold(f64::INFINITY, f64::min)
        };
        assert!(worst(&kept) >= 38.0);
        assert_eq!(rounds[0].step, Step::Unseen);
        assert!(rounds.iter().all(|round| round.kept == (round.loss <= 0.0)), "{rounds:?}");
        assert!(rounds.iter().any(|round| !round.kept));
    }

    #[test]
    fn fitting_saves_what_leaving_out_costs() {
        let splats = cloud(300, 1);
        let (fitted, _) = trimmed(&splats, 38.0, |_| ());
        let (bare, _) = trimmed(&splats, 38.0, |o| (o.sweeps, o.steps) = (0, 0));
        assert!(fitted.len() < bare.len(), "{} against {}", fitted.len(), bare.len());
    }

    #[test]
    fn a_loss_that_is_not_a_number_keeps_everything() {
        let splats = cloud(40, 2);
        assert_eq!(trimmed(&splats, f64::NAN, |_| ()).0, splats);
        assert_eq!(trimmed(&splats, f64::INFINITY, |o| o.range = Some(0.1)).0, splats);
    }

    #[test]
    fn bands_that_say_nothing_go() {
        let mut splats = cloud(80, 3);
        for own in splats.sh.chunks_exact_mut(48) {
            own[3..12].iter_mut().for_each(|v| *v *= 4.0);
            own[12..].fill(0.0);
        }
        let (kept, rounds) = trimmed(&splats, 45.0, |o| o.share = 0.0);
        assert_eq!(kept.sh_degree, 1, "{rounds:?}");
    }

    #[test]
    fn what_is_out_of_range_goes_where_it_is_not_needed() {
        let mut splats = cloud(60, 0);
        splats.positions[7] = [0.0, 0.0, 500.0];
        let (kept, rounds) = trimmed(&splats, 40.0, |o| (o.range, o.share) = (Some(20.0), 0.0));
        assert_eq!(rounds[0].step, Step::OutOfRange);
        assert!(rounds[0].kept && rounds[0].splats == 59, "{rounds:?}");
        assert!(kept.positions.iter().all(|p| p[2] < 20.0));
    }

    #[test]
    fn the_result_does_not_depend_on_the_number_of_threads() {
        let splats = cloud(120, 1);
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| trimmed(&splats, 36.0, |_| ()).0)
        };
        assert_eq!(run(1), run(3));
    }
}
