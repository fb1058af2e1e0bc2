//! The device's time by stage, with the bytes and operations that a model counts, and the best
//! rates of the device.

use anyhow::Context as _;
use nvsprior::render::probe::SortPrecision;
use nvsprior::render::{Jacobian, Job, Plan, Renderer};
use nvsprior::tracking::{FrameInfo, Objective, PoseEstimate, RefineOptions, Tracker};
use nvsprior::vulkan::StageTime;
use nvsprior::{Camera, EncoderOptions, Pose};
use serde::Serialize;

use super::commands::FrameCommands;
use super::context::{Best, Context, Shot};
use crate::ceilings::{self, Ceilings};
use crate::cost::{Cost, Counts, PICTURE_PASSES, SEARCH_PASSES, Sharing, Work};

/// Runs of each job whose stage times are averaged.
const RUNS: u32 = 10;
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
    pub stages: Vec<Stage>,
    /// Of a frame that takes one evaluation.
    pub commands: FrameCommands,
}

/// Measures a picture, both sums and a whole search of a frame that follows another.
pub fn measure(context: &Context) -> anyhow::Result<Stages> {
    let ceilings = ceilings::measure(context.engine.vulkan())?;
    let (camera, pose) = (context.shots[0].camera, context.best[0].pose);
    let counts = counts(context, &camera, &camera, &pose)?;
    let rated = |job, times: Vec<StageTime>, count: &dyn Fn(&str) -> Work| {
        let stage = |StageTime { name, milliseconds: ms }| {
            let (work, seconds) = (count(name), ms * 1e-3);
            // If the clock saw nothing pass, no rate is made up.
            let share = |amount: f64, best: f64| match seconds > 0.0 {
                true => amount / seconds / best,
                false => 0.0,
            };
            let share_of_copy = share(work.bytes, ceilings.bytes);
            let share_of_fma = share(work.flops, ceilings.flops);
            let bound = bound(share_of_copy, share_of_fma);
            Stage { job, name, ms, work, share_of_copy, share_of_fma, bound }
        };
        times.into_iter().map(stage).collect::<Vec<_>>()
    };
    let sharing = &Sharing::of(&context.engine, &context.prior);
    let picture = |name: &str| Cost { counts: &counts, sharing, passes: PICTURE_PASSES }.of(name);
    let mut stages = Vec::new();
    let jobs = [
        ("picture", Job::Picture),
        ("sums, flow", Job::Sums(Jacobian::Flow)),
        ("sums, exact", Job::Sums(Jacobian::Exact)),
    ];
    for (name, job) in jobs {
        stages.extend(rated(name, alone(context, job)?, &picture));
    }
    let search = search(context)?;
    stages.extend(rated("search", search.times, &|name| {
        let mut sum = match name {
            "splat" | "quantize_rgb8" => return picture(name),
            "pyramid" | "splat_flow" | "reduce" | "solve" => Work::default(),
            _ => picture(name),
        };
        for (counts, evaluations) in &search.levels {
            let times = if name == "pyramid" { 1.0 } else { *evaluations };
            sum += Cost { counts, sharing, passes: SEARCH_PASSES }.of(name) * times;
        }
        sum
    }));
    Ok(Stages { ceilings, counts, stages, commands: search.commands })
}

/// What a picture is made of there.
fn counts(
    context: &Context,
    camera: &Camera,
    frame: &Camera,
    pose: &Pose,
) -> anyhow::Result<Counts> {
    let probe = |room| {
        context.engine.probe().stages(&context.scene, camera, pose, room, SortPrecision::Exact)
    };
    let needed = probe(1)?.pairs_needed;
    Ok(Counts::of(&context.prior, camera, frame, &probe(needed)?))
}

/// Mean times of a job of the renderer.
fn alone(context: &Context, job: Job) -> anyhow::Result<Vec<StageTime>> {
    let Shot { camera, picture, .. } = &context.shots[0];
    let pose = context.best[0].pose;
    let jacobians = vec![Jacobian::Flow, Jacobian::Exact];
    let plan = Plan { jacobians, profiled: true, ..Plan::picture() };
    let mut renderer = context.engine.renderer(&context.scene, camera, plan)?;
    renderer.set_picture(picture);
    renderer.reduce_picture()?;
    let mut render = picture.clone();
    mean(|| {
        match job {
            Job::Sums(jacobian) => renderer.normal_equations(0, jacobian, &pose).map(|_| ())?,
            _ => renderer.picture(&pose, &mut render)?,
        }
        Ok(renderer.stage_times(job)?)
    })
}

/// A search, and the evaluations that it took at each level.
struct Search {
    times: Vec<StageTime>,
    levels: Vec<(Counts, f64)>,
    commands: FrameCommands,
}

/// The search of a frame after two earlier frames, or one; always the same.
fn search(context: &Context) -> anyhow::Result<Search> {
    let EncoderOptions { refine, factors, threshold, .. } = context.options();
    let (refine, profile): (RefineOptions, _) = (refine, nvsprior_kernels::search::COMPACT);
    let search = Some(refine.jacobian());
    let plan = Plan { factors, search, profiled: true, ..Plan::picture() };
    let last = (context.shots.len() - 1).min(2);
    let shot = &context.shots[last];
    let renderer = context.engine.renderer(&context.scene, &shot.camera, plan)?;
    let mut tracker = Tracker::new(Objective::new(renderer), refine, threshold, profile);
    let mut renders = Vec::new();
    let times = mean(|| {
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
    let cameras: Vec<Camera> = (0..renderer.levels()).map(|l| *renderer.camera(l)).collect();
    let pose = context.best[last].pose;
    let level = |(camera, evaluations): (&Camera, u32)| {
        Ok((counts(context, camera, &shot.camera, &pose)?, f64::from(evaluations)))
    };
    let levels = cameras.iter().zip(renders).map(level).collect::<anyhow::Result<_>>()?;
    Ok(Search { times, levels, commands })
}

/// Mean times over runs. The first run does not count: drivers finish their work at first use.
fn mean(mut run: impl FnMut() -> anyhow::Result<Vec<StageTime>>) -> anyhow::Result<Vec<StageTime>> {
    let mut sums: Vec<StageTime> = Vec::new();
    run()?;
    for _ in 0..RUNS {
        add_by_name(&mut sums, run()?);
    }
    for stage in &mut sums {
        stage.milliseconds /= f64::from(RUNS);
    }
    Ok(sums)
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
