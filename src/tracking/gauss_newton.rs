//! Gauss–Newton on the device (see [`crate::search`]): its options, and what it found.

use crate::Pose;
use crate::render::NormalEquations;
use crate::render::levels::{placement, pose_of};
use crate::search::{LEVELS, Placement, Program, STOP_NO_DESCENT, STOP_PROGRESS, Search};
use crate::shared::SUMS;
use crate::vulkan::Error;

use super::budget::{LEAST, Room};
use super::{
    Evaluation, Objective, Observability, Outcome, PoseCovariance, PoseEstimate, Schedule, Start,
    StartKind, Stop,
};

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
/// see [`crate::render::Renderer::search`]. The result is not judged yet. There must be `room` for two renders at
/// full size. If it cuts the search short there, before it ended by itself, it is not finished.
///
/// # Panics
/// If there is no start.
pub(super) fn search(
    objective: &mut Objective,
    starts: &[Pose],
    schedule: &Schedule,
    damping: f32,
    profile: u32,
    room: &Room,
) -> Result<PoseEstimate, Error> {
    assert!(!starts.is_empty(), "a search needs a start");
    let start = Start { pose: starts[0], kind: StartKind::External };
    let renderer = objective.renderer();
    let placements = starts.iter().map(|pose| placement(renderer.scene(), pose));
    let levels = renderer.levels();
    let within = schedule.within(room, levels);
    let program = within.program(levels, placements, damping, profile);
    let program = Program { sparse: objective.sparse_levels(program.sparse), ..program };
    let (mut first, path) = run(objective, &start, &program)?;
    first.finished = within.renders == schedule.renders || first.outcome.stop != Stop::Iterations;
    // Some rows of tiles may leave a motion undetermined that the whole picture determines.
    let determined = program.sparse == 0 || first.observability.undetermined().next().is_none();
    if path.kept_promise() && determined {
        return Ok(first);
    }
    let better = if path.drawn_mse < path.seen_mse { path.found } else { path.seen };
    let room = room.after(path.by_level[0] + 1, path.by_level[1..].iter().sum());
    if !room.holds(LEAST, 0) {
        let pose = pose_of(objective.renderer().scene(), &better);
        let drawn = first.drawn.filter(|_| better == path.found);
        let outcome = Outcome { pose, mse: first.outcome.mse.min(path.seen_mse), ..first.outcome };
        return Ok(PoseEstimate { outcome, drawn, finished: false, ..first });
    }
    let first_level = schedule.first_level.max(schedule.far_level);
    let to_the_end = Schedule { leap: 0.0, coarse_leap: 0.0, sparse: 0, far_level: 0, ..*schedule };
    let again = Schedule { first_level, follow_level: first_level, ..to_the_end };
    let within = again.within(&room, levels);
    let (second, _) = run(objective, &start, &within.program(levels, [better], damping, profile))?;
    let finished = within.renders == again.renders || second.outcome.stop != Stop::Iterations;
    let submissions = first.submissions + second.submissions;
    Ok(PoseEstimate { submissions, first_mse: first.first_mse, finished, ..second })
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
    /// Evaluations by level.
    by_level: [u32; LEVELS],
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
        by_level: search.by_level,
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
