//! Gauss–Newton on the device (see [`crate::search`]): its options, and what it found.

use crate::Pose;
use crate::render::NormalEquations;
use crate::render::levels::{placement, pose_of};
use crate::search::{LEVELS, Placement, Program, STARTS, STOP_NO_DESCENT, STOP_PROGRESS, Search};
use crate::shared::SUMS;
use crate::vulkan::Error;

use super::{
    Evaluation, Objective, Observability, Outcome, PoseCovariance, PoseEstimate, Start, StartKind,
    Stop,
};

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

/// Options of Gauss–Newton.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GaussNewtonOptions {
    /// For a frame that follows another.
    pub warm: Schedule,
    /// For a frame if only a rough pose is known.
    pub cold: Schedule,
    /// First damping, relative to the diagonal of JᵀJ.
    pub damping: f32,
}

impl Default for GaussNewtonOptions {
    fn default() -> Self {
        GaussNewtonOptions {
            warm: Schedule {
                first_level: 0,
                follow_level: 0,
                levels: 0b0111,
                sparse: 0b0001,
                follow_renders: 1,
                coarse_renders: 8,
                renders: 6,
                near: 0.6,
                far_level: 2,
                coarse_leap: 0.3,
                leap: 0.08,
                coarse_tolerance: 1e-3,
                tolerance: 1e-4,
            },
            cold: Schedule {
                first_level: 2,
                follow_level: 2,
                levels: 0b0111,
                sparse: 0,
                follow_renders: 1,
                coarse_renders: 12,
                renders: 8,
                near: 1.0,
                far_level: 0,
                coarse_leap: 0.05,
                leap: 0.08,
                coarse_tolerance: 1e-3,
                tolerance: 1e-4,
            },
            damping: 1e-3,
        }
    }
}

/// Searches from `starts` (only the first eight count), draws the outcome and takes the difference:
/// see [`crate::render::Renderer::search`]. The result is not judged yet.
///
/// # Panics
/// If there is no start.
pub(super) fn search(
    objective: &mut Objective,
    starts: &[Pose],
    schedule: &Schedule,
    damping: f32,
    profile: u32,
) -> Result<PoseEstimate, Error> {
    assert!(!starts.is_empty(), "a search needs a start");
    let start = Start { pose: starts[0], kind: StartKind::External };
    let renderer = objective.renderer();
    let placements = starts.iter().map(|pose| placement(renderer.scene(), pose));
    let program = schedule.program(renderer.levels(), placements, damping, profile);
    let program = Program { sparse: objective.sparse_levels(program.sparse), ..program };
    let (first, path) = run(objective, &start, &program)?;
    // Some rows of tiles may leave a motion undetermined that the whole picture determines.
    let determined = program.sparse == 0 || first.observability.undetermined().next().is_none();
    if path.kept_promise() && determined {
        return Ok(first);
    }
    let better = if path.drawn_mse < path.seen_mse { path.found } else { path.seen };
    let mut again = Program { sparse: 0, ..program };
    (again.starts[0], again.count) = (better, 1);
    again.first_level = program.first_level.max(program.far_level);
    (again.follow_level, again.far_level) = (again.first_level, 0);
    (again.leap, again.coarse_leap) = (0.0, 0.0);
    let (second, _) = run(objective, &start, &again)?;
    let submissions = first.submissions + second.submissions;
    Ok(PoseEstimate { submissions, first_mse: first.first_mse, ..second })
}

/// Error that 8 bits bring, of values in [0, 1].
const ROUNDING: f64 = 1.0 / (12.0 * 255.0 * 255.0);

/// How a run of the device came to its end.
struct Path {
    found: Placement,
    /// Share by which the last step, taken without an evaluation, promised to lower the error.
    promised: f64,
    /// Best place that was evaluated at full resolution.
    seen: Placement,
    /// Mean squared error there.
    seen_mse: f64,
    /// Mean squared error of the same pixels in the picture that was drawn at the end.
    drawn_mse: f64,
}

impl Path {
    /// Whether the drawn picture's error is what the last step promised. It must not be worse than before the step; and
    /// if the step promised much, it must be better by a good part of that. Near the optimum Gauss–Newton keeps its
    /// promises. If it does not, the search has not arrived.
    fn kept_promise(&self) -> bool {
        let max = if self.promised > 0.03 { 1.0 - 0.8 * self.promised } else { 1.02 };
        self.promised == 0.0 || self.drawn_mse - ROUNDING <= max * self.seen_mse
    }
}

/// Runs a program on the device.
fn run(
    objective: &mut Objective,
    start: &Start,
    program: &Program,
) -> Result<(PoseEstimate, Path), Error> {
    let begun = objective.milliseconds();
    let levels: [f64; LEVELS] = objective.residuals(program.sparse);
    let (renderer, trace) = objective.parts();
    let scene = renderer.scene().clone();
    let searched = renderer.search(program)?;
    let (search, code, submissions) = (searched.search, searched.code, searched.submissions);
    let evaluations =
        search.trace.iter().zip(&search.trace_level).take(search.evaluations as usize);
    for ((square, level), time) in evaluations.zip(searched.times) {
        let mse = f64::from(*square) / levels[*level as usize];
        trace.note(Evaluation { level: *level as usize, mse, milliseconds: begun + time });
    }
    let search = *search;
    let [mse, sparse_mse] = objective.errors();
    let drawn_mse = if program.sparse & 1 == 1 { sparse_mse } else { mse };
    let path = Path {
        found: search.found,
        promised: f64::from(search.promised),
        seen: search.place,
        seen_mse: f64::from(search.place_sums[SUMS as usize - 1]) / levels[0],
        drawn_mse,
    };
    let stop = stop(&search);
    let first_mse = f64::from(search.trace[0]) / levels[search.trace_level[0] as usize];
    // Of all pixels, like the error at the end.
    let sparse_start = program.sparse >> search.trace_level[0] & 1 == 1 && sparse_mse > 0.0;
    let first_mse = first_mse * if sparse_start { mse / sparse_mse } else { 1.0 };
    let sums = search.place_sums.map(f64::from);
    let observability = Observability::of(&NormalEquations::from_sums(&sums, levels[0] as usize));
    let pose = pose_of(&scene, &path.found);
    let tiles = objective.renderer().tile_sums(program.sparse);
    let found = PoseEstimate {
        drawn: Some(code),
        submissions,
        first_mse,
        observability,
        covariance: PoseCovariance::of(&tiles, observability.length, mse),
        ..PoseEstimate::from_start(start, Outcome { pose, mse, stop })
    };
    Ok((found, path))
}

fn stop(search: &Search) -> Stop {
    match search.stop {
        STOP_PROGRESS => Stop::Progress,
        STOP_NO_DESCENT => Stop::NoDescent,
        _ => Stop::Iterations,
    }
}
