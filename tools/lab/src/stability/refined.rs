//! Searches for a frame's pose with one of the optimisers, and checks what is always expected.

use std::time::Instant;

use anyhow::Context as _;
use nvsprior::render::{Jacobian, Plan};
use nvsprior::tracking::{Objective, Observability, Outcome, RefineOptions, Tracker};
use nvsprior::{Camera, Picture, Pose, Prior};
use nvsprior_kernels::search::COMPACT;
use nvsprior_paper::{DescentOptions, Optimizer, minimise};

use super::case::{Bench, Descent, Row};

pub const OPTIMIZERS: [Optimizer; 4] =
    [Optimizer::GaussNewton, Optimizer::Bfgs, Optimizer::Adam, Optimizer::AdamBfgs];

/// What a search came to.
pub struct Refinement {
    pub outcome: Outcome,
    pub observability: Observability,
    evaluations: usize,
}

/// A frame of a prior, and the start of searches for its pose.
pub struct Sought<'a> {
    pub prior: &'a Prior,
    pub camera: Camera,
    pub frame: &'a Picture,
    pub start: Pose,
}

/// The picture of a prior from a pose.
pub fn picture(
    bench: &Bench,
    prior: &Prior,
    camera: &Camera,
    pose: &Pose,
) -> anyhow::Result<Picture> {
    let scene = bench.engine.upload(prior)?;
    let mut picture = Picture::new(camera.width, camera.height);
    bench.engine.renderer(&scene, camera, Plan::picture())?.picture(pose, &mut picture)?;
    Ok(picture)
}

impl Sought<'_> {
    /// Searches, and checks what every search must do: end no worse than it began, at finite numbers, and no farther
    /// off than the scene is deep.
    pub fn refine(&self, bench: &Bench, optimizer: Optimizer) -> anyhow::Result<(Refinement, Row)> {
        let since = Instant::now();
        let refine = RefineOptions::default();
        let search = optimizer == Optimizer::GaussNewton;
        let plan = Plan {
            factors: vec![1, 2, 4, 8],
            jacobians: if search { Vec::new() } else { vec![Jacobian::Exact] },
            search: search.then_some(refine.jacobian),
            sort_precision: refine.sort_precision,
            depths: false,
            profiled: false,
        };
        let scene = bench.engine.upload(self.prior)?;
        let renderer = bench.engine.renderer(&scene, &self.camera, plan)?;
        let objective = Objective::new(renderer);
        let found = match search {
            true => self.tracked(objective, refine)?,
            false => self.descended(objective, optimizer)?,
        };
        let begun = picture(bench, self.prior, &self.camera, &self.start)?.mse(self.frame);
        let end = picture(bench, self.prior, &self.camera, &found.outcome.pose)?.mse(self.frame);
        let mut row = Row::of(optimizer.name(), since);
        let (stop, evaluations) = (found.outcome.stop, found.evaluations);
        row.descent = Some(Descent { start: begun, end, stop, evaluations });
        row.expect(found.outcome.pose.is_finite(), || "the pose found is no number".into());
        row.expect(end <= begun + ROUNDING, || {
            format!("the search went from {begun:.4e} up to {end:.4e}")
        });
        let (moved, length) = (self.moved(&found), found.observability.length);
        row.expect(!(moved > 4.0 * length) || length == 0.0, || {
            format!("moved by {moved:.3e} units, {length:.3e} deep")
        });
        row.note = spectrum(&found);
        Ok((found, row))
    }

    /// By the engine.
    fn tracked(&self, objective: Objective, refine: RefineOptions) -> anyhow::Result<Refinement> {
        let mut tracker = Tracker::new(objective, refine, 1e-3, COMPACT);
        let found = tracker.track(self.frame, &self.start.into())?;
        let found = found.context("a start was given")?;
        let (outcome, observability) = (found.outcome, found.observability);
        Ok(Refinement { outcome, observability, evaluations: tracker.trace().len() })
    }

    /// By one of the paper's methods.
    fn descended(
        &self,
        mut objective: Objective,
        optimizer: Optimizer,
    ) -> anyhow::Result<Refinement> {
        objective.set_frame(self.frame);
        let options = DescentOptions { optimizer, ..DescentOptions::default() };
        let outcome = minimise(&mut objective, &self.start, &options)?;
        let (observability, evaluations) = (*objective.observability(), objective.trace().len());
        Ok(Refinement { outcome, observability, evaluations })
    }

    /// How far the camera went from the start, the prior's unit.
    pub fn moved(&self, found: &Refinement) -> f64 {
        (found.outcome.pose.centre() - self.start.centre()).length()
    }
}

/// Mean squared error that rounding to 8 bits may add or hide.
const ROUNDING: f64 = 2.0 / (12.0 * 255.0 * 255.0);

/// Condition, deviations and open directions, in words.
fn spectrum(found: &Refinement) -> String {
    let o = &found.observability;
    let open = o.undetermined().count();
    format!(
        "condition {:.1e}, least determined ± {:.1e}, {open} of 6 open, scene {:.3e} deep",
        o.condition, o.deviations[0], o.length
    )
}
