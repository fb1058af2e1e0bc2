//! What is measured at one size of pictures.

use nvsprior::image::Preprocessor;
use nvsprior::vulkan::MemoryUse;
use nvsprior::{Camera, EncoderOptions, Engine};
use nvsprior_basin::DemoFrame;
use nvsprior_inputs::args::{progress, with_progress};

use super::coding::{self, ShotPose};
use super::measuring::{Measuring, Subject};
use super::pace::Pace;
use super::schema::Size;
use super::stages;
use crate::bench::context::{Best, Context, Shot, host_bytes};
use crate::bench::forward::Forward;
use crate::bench::report::Figures;
use crate::bench::stages::Runs;
use crate::bench::{perturbed, steady, trials};
use crate::cost::Machine;
use nvsprior_inputs::statistics::median;

/// The demo's: a frame starts from the one before if the mean squared error there is below this.
const THRESHOLD: f64 = 1e-2;
/// Forward renders that a search takes, about, with three to compare with: of a frame that follows another, and of one
/// from a start moved off, as the first one of a run is.
const FOLLOWING: f64 = 10.0;
/// See [`FOLLOWING`].
const MOVED_OFF: f64 = 20.0;
/// What each part may take of a size's seconds.
const DRAWING: f64 = 0.05;
const STAGES: f64 = 0.2;
const STEADY: f64 = 0.35;
const TRIALS: f64 = 0.3;
const CODING: f64 = 0.1;

/// A size under way.
struct Measured {
    context: Context,
    size: Size,
    /// What all of it may take, about.
    seconds: f64,
    /// What a forward render takes.
    render_seconds: f64,
    machine: Option<Machine>,
}

impl Measuring {
    /// Measures at a camera's size in about so many seconds.
    pub fn size(
        &mut self,
        engine: &Engine,
        subject: &Subject,
        camera: &Camera,
        machine: Option<Machine>,
        seconds: f64,
    ) {
        let most = self.report.bounds.frames as usize + 1;
        let pace = self.pace(seconds * DRAWING);
        let opened = self.part(&at(camera, "frames"), || open(engine, subject, camera, most, pace));
        let Some(mut context) = opened else { return };
        let forward = self.part(&at(camera, "forward renders"), || {
            context.forward.measure(camera, &context.best[0].pose)
        });
        let size = Size::of(&context);
        let render_seconds = forward.unwrap_or(f64::NAN) * 1e-3;
        let mut measured = Measured { context, size, seconds, render_seconds, machine };
        self.stages(&mut measured, camera);
        let found = self.follow(&mut measured, camera);
        self.coding(&mut measured, camera, &found, subject.budgets);
        self.moved_off(&mut measured, camera);
        let Measured { context, mut size, .. } = measured;
        size.forward_render_ms = forward.map(|_| median(context.forward.times.iter().copied()));
        self.memory(&context, &mut size);
        self.report.sizes.push(size);
    }

    fn stages(&mut self, measured: &mut Measured, camera: &Camera) {
        let Some(best) = self.report.ceilings else { return };
        let end = Some(self.pace(measured.seconds * STAGES).end());
        let runs = Runs { most: self.report.bounds.runs, end, fastest: true };
        let Measured { context, machine, .. } = &measured;
        let rows = self.part(&at(camera, "stages"), || {
            stages::measure(context, &best, machine.as_ref(), runs)
        });
        measured.size.stages = rows.unwrap_or_default();
    }

    /// Measures the search for frames that follow each other. Returns the poses to code frames at.
    fn follow(&mut self, measured: &mut Measured, camera: &Camera) -> Vec<ShotPose> {
        let Measured { context, size, seconds, render_seconds, .. } = measured;
        let pace = self.pace(*seconds * STEADY);
        let what = at(camera, "search, frame after frame");
        let samples =
            self.if_affordable(&what, &pace, (MOVED_OFF + FOLLOWING) * *render_seconds, || {
                let options = EncoderOptions { rate: None, ..context.options() };
                let frames = context.shots.len();
                with_progress(frames, "frames", |done| {
                    steady::measure(context, options, frames, || and_on(done, &pace))
                })
            });
        size.steady = samples.as_ref().map(|samples| Figures::of(context, samples));
        let mut found: Vec<ShotPose> = context.best.iter().enumerate().map(known).collect();
        for sample in samples.iter().flatten() {
            let (pose, search_ms) = (sample.pose, Some(sample.frame_ms()));
            found[sample.shot] = ShotPose { shot: sample.shot, pose, search_ms };
        }
        // If a search was measured, only its frames are coded, after the first one.
        found.truncate(samples.map_or(found.len(), |samples| samples.len() + 1));
        found
    }

    /// Measures the search from starts moved off.
    fn moved_off(&mut self, measured: &mut Measured, camera: &Camera) {
        let Measured { context, size, seconds, render_seconds, .. } = measured;
        let (most, pace) = (self.report.bounds.trials as usize, self.pace(*seconds * TRIALS));
        let what = at(camera, "search, starts moved off");
        let trials = self.if_affordable(&what, &pace, 2.0 * MOVED_OFF * *render_seconds, || {
            with_progress(most, "starts", |done| {
                trials::measure(context, perturbed::NEAR, most, || and_on(done, &pace))
            })
        });
        size.perturbed_3deg = trials.map(|samples| Figures::of(context, &samples));
    }

    fn coding(
        &mut self,
        measured: &mut Measured,
        camera: &Camera,
        found: &[ShotPose],
        budgets: &[usize],
    ) {
        let Measured { context, size, seconds, .. } = measured;
        for budget in budgets {
            let pace = self.pace(*seconds * CODING / budgets.len() as f64);
            let coded = self.part(&at(camera, &format!("coding for {budget} bytes")), || {
                with_progress(found.len(), "frames", |done| {
                    coding::measure(context, found, *budget, &pace, done)
                })
            });
            size.coding.extend(coded);
        }
    }

    /// Does a part if it has the time for a first repeat and one that counts: so many seconds.
    fn if_affordable<T>(
        &mut self,
        what: &str,
        pace: &Pace,
        seconds: f64,
        work: impl FnOnce() -> anyhow::Result<T>,
    ) -> Option<T> {
        if !pace.affords(seconds) {
            self.missing(what, "it would take longer than the report may");
            return None;
        }
        self.part(what, work)
    }

    fn memory(&mut self, context: &Context, size: &mut Size) {
        let MemoryUse { used, reserved, .. } = context.device_memory;
        if reserved > 0 {
            size.device_memory_bytes = Some(reserved);
            size.device_memory_used_bytes = Some(used);
        } else {
            self.missing("device memory", "no frame was searched for");
        }
        size.host_memory_bytes = host_bytes();
        if size.host_memory_bytes.is_none() {
            self.missing("host memory", "the system does not tell");
        }
    }
}

/// Says that a repeat is done, and whether another may begin.
fn and_on(done: &dyn Fn(), pace: &Pace) -> bool {
    done();
    pace.goes_on()
}

/// A part's name.
fn at(camera: &Camera, what: &str) -> String {
    format!("{}×{}: {what}", camera.width, camera.height)
}

/// A frame at the best known pose.
fn known((shot, best): (usize, &Best)) -> ShotPose {
    ShotPose { shot, pose: best.pose, search_ms: None }
}

/// Uploads the prior; draws frames, and their renders, as long as the pace allows, two at least.
fn open(
    engine: &Engine,
    subject: &Subject,
    camera: &Camera,
    most: usize,
    pace: Pace,
) -> anyhow::Result<Context> {
    let (prior, engine) = (subject.prior.clone(), engine.clone());
    let scene = engine.upload(&prior)?;
    let mut preprocessor = Preprocessor::new(prior.preprocessing());
    let mut forward = Forward::new(&engine, &scene);
    let (mut shots, mut best) = (Vec::new(), Vec::new());
    let bar = progress(most, "drawing");
    let mut drawn = (subject.frames)(*camera);
    while shots.len() < most && (shots.len() < 2 || pace.goes_on()) {
        let Some(DemoFrame { name, mut picture, pose, time }) = drawn.next() else { break };
        preprocessor.apply(&mut picture);
        let psnr = picture.psnr(forward.picture(camera, &pose)?);
        best.push(Best { pose, psnr });
        let (file, known, time) = (name.clone(), Some(pose), Some(time));
        shots.push(Shot { file, name, camera: *camera, picture, external: None, known, time });
        bar.inc(1);
    }
    anyhow::ensure!(shots.len() > 1, "one frame is no run, as the first one does not count");
    drop(drawn);
    let (threshold, device_memory) = (THRESHOLD, MemoryUse::default());
    Ok(Context { engine, prior, scene, shots, best, forward, threshold, device_memory })
}

impl Size {
    /// With nothing measured yet.
    fn of(context: &Context) -> Size {
        let Camera { width, height, .. } = context.shots[0].camera;
        let (splats, frames) = (context.prior.splats().len(), context.shots.len());
        Size { width, height, splats, frames, ..Size::default() }
    }
}
