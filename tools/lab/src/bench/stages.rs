//! The device's time by stage, with the bytes and operations that a model counts, and the best
//! rates of the device.

use std::time::Instant;

use anyhow::Context as _;
use nvsprior::packet::{PoseProfile, QuantisedPose};
use nvsprior::render::{Jacobian, Job, Plan, Renderer};
use nvsprior::tracking::{
    FrameInfo, GaussNewtonOptions, Objective, PoseEstimate, RefineOptions, Schedule, Tracker,
};
use nvsprior::vulkan::StageTime;
use nvsprior::{Camera, EncoderOptions, Pose};
use nvsprior_reference::probe::{Probe, SortPrecision};
use serde::Serialize;

use super::commands::FrameCommands;
use super::context::{Best, Context, Shot};
use crate::ceilings::{self, Ceilings};
use crate::cost::{Cost, Counts, PICTURE_PASSES, SEARCH_PASSES, Sharing, Work};

/// How often a job runs, and which times count.
#[derive(Clone, Copy)]
pub struct Runs {
    /// Runs that count.
    pub most: u32,
    /// None begins after this moment, but the first.
    pub end: Option<Instant>,
    /// Of each stage its fastest time counts, else the mean.
    pub fastest: bool,
}

impl Runs {
    /// As `nvsprior-lab bench` has it.
    pub const BENCH: Runs = Runs { most: 10, end: None, fastest: false };

    fn goes_on(&self, done: u32) -> bool {
        done < self.most && (done == 0 || self.end.is_none_or(|end| Instant::now() < end))
    }
}

/// Jobs that the host asks for, by the names of reports.
pub const PICTURE: (&str, Job) = ("picture", Job::Picture);
/// See [`PICTURE`].
pub const FLOW: (&str, Job) = ("sums, flow", Job::Sums(Jacobian::Flow));
const EXACT: (&str, Job) = ("sums, exact", Job::Sums(Jacobian::Exact));
/// The job of a whole search.
pub const SEARCH: &str = "search";

/// If a stage reaches this share of a ceiling, the ceiling bounds it.
const BOUND: f64 = 0.35;

#[derive(Serialize)]
pub struct Stage {
    pub job: &'static str,
    pub name: &'static str,
    pub ms: f64,
    #[serde(flatten)]
    pub work: Work,
    /// Bytes per second, as a share of the copy's.
    pub share_of_copy: f64,
    /// Operations per second, as a share of the multiply-adds'.
    pub share_of_fma: f64,
    pub bound: &'static str,
}

impl Stage {
    fn of(job: &'static str, time: &StageTime, work: Work, ceilings: &Ceilings) -> Stage {
        let StageTime { name, milliseconds: ms } = *time;
        // If the clock saw nothing pass, no rate is made up.
        let share = |amount: f64, best: f64| match ms > 0.0 {
            true => amount / (ms * 1e-3) / best,
            false => 0.0,
        };
        let share_of_copy = share(work.bytes, ceilings.bytes);
        let share_of_fma = share(work.flops, ceilings.flops);
        let bound = bound(share_of_copy, share_of_fma);
        Stage { job, name, ms, work, share_of_copy, share_of_fma, bound }
    }
}

/// What bounds a stage of these shares: `copy`, `arithmetic`, or `neither` if it stays below a third of both. Then it
/// waits for other invocations, single words, divisions, or its own dispatch.
fn bound(share_of_copy: f64, share_of_fma: f64) -> &'static str {
    match (share_of_copy, share_of_fma) {
        (copy, fma) if copy.max(fma) < BOUND => "neither",
        (copy, fma) if copy > fma => "copy",
        _ => "arithmetic",
    }
}

pub struct Stages {
    pub ceilings: Ceilings,
    /// Of the picture that is measured at.
    pub counts: Counts,
    levels: Vec<Level>,
    pub stages: Vec<Stage>,
    /// Of a frame that takes one evaluation.
    pub commands: FrameCommands,
}

/// A level of a search.
struct Level {
    /// Of the whole level.
    whole: Counts,
    /// Of the rows of tiles that an evaluation draws.
    drawn: Counts,
    evaluations: f64,
}

/// A part of what a stage does in a job: pictures of the same counts.
pub struct Part<'a> {
    pub counts: &'a Counts,
    /// Passes of their sort.
    pub passes: u32,
    /// How many there are.
    pub times: f64,
}

impl Stages {
    /// Of a picture and a search that were not timed.
    #[cfg(test)]
    pub fn unmeasured(ceilings: Ceilings, counts: Counts, evaluations: f64) -> Stages {
        let levels = vec![Level { whole: counts, drawn: counts, evaluations }];
        Stages { ceilings, counts, levels, stages: Vec::new(), commands: FrameCommands::default() }
    }

    /// What a stage of a job is made of.
    pub fn parts(&self, job: &str, stage: &str) -> Vec<Part<'_>> {
        parts(&self.counts, &self.levels, job, stage)
    }
}

fn parts<'a>(counts: &'a Counts, levels: &'a [Level], job: &str, stage: &str) -> Vec<Part<'a>> {
    let picture = Part { counts, passes: PICTURE_PASSES, times: 1.0 };
    if job != SEARCH {
        return vec![picture];
    }
    let mut parts = match stage {
        "splat" | "quantize_rgb8" => return vec![picture],
        "pyramid" | "splat_flow" | "splat_exact" | "pose_jacobian" | "reduce" | "solve" => vec![],
        _ => vec![picture],
    };
    parts.extend(levels.iter().map(|level| match stage {
        "pyramid" => Part { counts: &level.whole, passes: SEARCH_PASSES, times: 1.0 },
        _ => Part { counts: &level.drawn, passes: SEARCH_PASSES, times: level.evaluations },
    }));
    parts
}

/// Measures a picture, both sums and a whole search of a frame that follows another.
pub fn measure(context: &Context) -> anyhow::Result<Stages> {
    let ceilings = ceilings::measure(context.engine.vulkan())?;
    measure_jobs(context, ceilings, &[PICTURE, FLOW, EXACT], search, Runs::BENCH)
}

/// Measures some jobs and a search. Without timestamps there are no stages.
pub fn measure_jobs(
    context: &Context,
    ceilings: Ceilings,
    jobs: &[(&'static str, Job)],
    search: fn(&Context, Runs) -> anyhow::Result<Search>,
    runs: Runs,
) -> anyhow::Result<Stages> {
    let (camera, pose) = (context.shots[0].camera, context.best[0].pose);
    let counts = counts(context, &camera, &camera, &pose, 0)?;
    let mut times = Vec::new();
    for (name, job) in jobs {
        times.push((*name, alone(context, *job, runs)?));
    }
    let Search { times: searched, levels, commands } = search(context, runs)?;
    times.push((SEARCH, searched));
    let sharing = Sharing::of(&context.engine, &context.prior);
    let work = |job: &str, stage: &str| {
        let mut sum = Work::default();
        for Part { counts, passes, times } in parts(&counts, &levels, job, stage) {
            sum += Cost { counts, sharing: &sharing, passes }.of(stage) * times;
        }
        sum
    };
    let rate = |(job, times): (&'static str, Vec<StageTime>)| {
        let stage = |time: StageTime| Stage::of(job, &time, work(job, time.name), &ceilings);
        times.into_iter().map(stage).collect::<Vec<_>>()
    };
    let stages = times.into_iter().flat_map(rate).collect();
    Ok(Stages { ceilings, counts, levels, stages, commands })
}

/// What a picture is made of there, if one of 2^`row_shift` rows of tiles is drawn.
fn counts(
    context: &Context,
    camera: &Camera,
    frame: &Camera,
    pose: &Pose,
    row_shift: u32,
) -> anyhow::Result<Counts> {
    let probe = |room| {
        Probe::of(&context.engine).stages(&context.scene, camera, pose, room, SortPrecision::Exact)
    };
    let needed = probe(1)?.pairs_needed;
    Ok(Counts::of(&context.prior, camera, frame, &probe(needed)?, row_shift))
}

/// Times of a job of the renderer.
fn alone(context: &Context, job: Job, runs: Runs) -> anyhow::Result<Vec<StageTime>> {
    let Shot { camera, picture, .. } = &context.shots[0];
    let pose = context.best[0].pose;
    let jacobians = match job {
        Job::Sums(jacobian) => vec![jacobian],
        _ => vec![Jacobian::Flow],
    };
    let plan = Plan { jacobians, profiled: true, ..Plan::picture() };
    let mut renderer = context.engine.renderer(&context.scene, camera, plan)?;
    renderer.set_picture(picture);
    renderer.reduce_picture()?;
    let mut render = picture.clone();
    times(context, runs, || {
        match job {
            Job::Sums(jacobian) => renderer.normal_equations(0, jacobian, &pose).map(|_| ())?,
            _ => renderer.picture(&pose, &mut render)?,
        }
        Ok(renderer.stage_times(job)?)
    })
}

/// A search, and the evaluations that it took at each level.
pub struct Search {
    times: Vec<StageTime>,
    levels: Vec<Level>,
    commands: FrameCommands,
}

/// The search of a frame after two earlier frames, or one; always the same.
fn search(context: &Context, runs: Runs) -> anyhow::Result<Search> {
    let EncoderOptions { refine, factors, threshold, .. } = context.options();
    let (refine, profile): (RefineOptions, _) = (refine, nvsprior_kernels::search::COMPACT);
    let search = Some(refine.jacobian);
    let plan = Plan { factors, search, profiled: true, ..Plan::picture() };
    let last = (context.shots.len() - 1).min(2);
    let shot = &context.shots[last];
    let renderer = context.engine.renderer(&context.scene, &shot.camera, plan)?;
    let mut tracker = Tracker::new(Objective::new(renderer), refine, threshold, profile);
    let mut renders = Vec::new();
    let times = times(context, runs, || {
        tracker.reset();
        for Best { pose, psnr } in &context.best[..last] {
            tracker.keep(&PoseEstimate::known(*pose, 10f64.powf(-0.1 * psnr)));
        }
        let before = tracker.objective().renderer().renders().to_vec();
        tracker.track(&shot.picture, &FrameInfo::default())?;
        let renderer = tracker.objective().renderer();
        renders = renderer.renders().iter().zip(before).map(|(now, then)| now - then).collect();
        Ok(renderer.stage_times(Job::Search)?)
    })?;
    // The final picture is no evaluation.
    renders[0] = renders[0].saturating_sub(1);
    let renderer: &mut Renderer = tracker.objective().renderer();
    let commands = renderer.search_commands().context("a search is planned")?;
    let commands = FrameCommands::of(&commands);
    let pose = context.best[last].pose;
    let sparse = refine.gauss_newton.warm.sparse;
    let level = |(level, evaluations): (usize, u32)| {
        measured_level(context, renderer, level, &pose, sparse, evaluations)
    };
    let levels = renders.into_iter().enumerate().map(level).collect::<anyhow::Result<_>>()?;
    Ok(Search { times, levels, commands })
}

/// A level at a pose, and the evaluations that a search took there. `sparse`: see [`Schedule::sparse`].
fn measured_level(
    context: &Context,
    renderer: &Renderer,
    level: usize,
    pose: &Pose,
    sparse: u32,
    evaluations: u32,
) -> anyhow::Result<Level> {
    let (camera, frame) = (renderer.camera(level), renderer.camera(0));
    let whole = counts(context, camera, frame, pose, 0)?;
    let drawn = match sparse >> level & 1 {
        1 => counts(context, camera, frame, pose, renderer.sparse_shift(level))?,
        _ => whole,
    };
    Ok(Level { whole, drawn, evaluations: f64::from(evaluations) })
}

/// Evaluations of [`search_nearby`].
const NEARBY: u32 = 2;

/// A search of few evaluations at full size from the best known pose: one submission, whatever the frame.
pub fn search_nearby(context: &Context, runs: Runs) -> anyhow::Result<Search> {
    let EncoderOptions { refine, factors, .. } = context.options();
    let profile = PoseProfile::Compact;
    let (shot, pose) = (&context.shots[0], &context.best[0].pose);
    let search = Some(refine.jacobian);
    let plan = Plan { factors, search, profiled: true, ..Plan::picture() };
    let mut renderer = context.engine.renderer(&context.scene, &shot.camera, plan)?;
    renderer.set_picture(&shot.picture);
    let code = QuantisedPose::quantise(pose, &context.prior.coordinate_frame(), profile)?.words();
    let GaussNewtonOptions { warm, damping, .. } = refine.gauss_newton;
    let schedule = Schedule { first_level: 0, follow_level: 0, levels: 1, renders: NEARBY, ..warm };
    let starts = [renderer.placed(&code)];
    let program = schedule.program(renderer.levels(), starts, damping, profile.word());
    let mut evaluations = 0;
    let times = times(context, runs, || {
        evaluations = renderer.search(&program)?.search.by_level[0];
        Ok(renderer.stage_times(Job::Search)?)
    })?;
    let commands = renderer.search_commands().context("a search is planned")?;
    let commands = FrameCommands::of(&commands);
    let level = measured_level(context, &renderer, 0, pose, schedule.sparse, evaluations)?;
    Ok(Search { times, levels: vec![level], commands })
}

/// Times over runs, after a warm-up. The first run never counts: drivers finish their work at first use.
fn times(
    context: &Context,
    runs: Runs,
    mut run: impl FnMut() -> anyhow::Result<Vec<StageTime>>,
) -> anyhow::Result<Vec<StageTime>> {
    let (start, warm_up) = (Instant::now(), ceilings::warm_up(context.engine.device()));
    run()?;
    while start.elapsed() < warm_up {
        run()?;
    }
    let mut all: Vec<Vec<StageTime>> = Vec::new();
    while runs.goes_on(all.len() as u32) {
        let mut sums = Vec::new();
        add_by_name(&mut sums, run()?);
        all.push(sums);
    }
    let of = |at: usize| all.iter().map(move |times| times[at].milliseconds);
    let names = all.first().into_iter().flatten().enumerate();
    let stage = |(at, time): (usize, &StageTime)| {
        let milliseconds = match runs.fastest {
            true => of(at).fold(f64::INFINITY, f64::min),
            false => of(at).sum::<f64>() / all.len() as f64,
        };
        StageTime { name: time.name, milliseconds }
    };
    Ok(names.map(stage).collect())
}

/// Adds times to those of the same name: a sort's passes count as one stage.
fn add_by_name(sums: &mut Vec<StageTime>, times: Vec<StageTime>) {
    for time in times {
        match sums.iter_mut().find(|sum| sum.name == time.name) {
            Some(sum) => sum.milliseconds += time.milliseconds,
            None => sums.push(time),
        }
    }
}
