//! One frame given to an encoder, and what came of it.

use std::sync::Arc;
use std::time::Instant;

use anyhow::Context as _;
use nvsprior::render::Scene;
use nvsprior::{Encoder, EncoderOptions, Error, FrameInfo, Picture};

use super::super::context::{Best, Context, Shot};
use super::super::forward::Forward;
use super::super::optimum::beyond;
use super::super::perturbed::SHORT;
use super::Measurement;

/// Further below the best known pose's render than this, a pose is wrong, dB.
pub const WRONG: f64 = 1.0;

/// How often an encoder that has not found its pose gets the same frame: a lost encoder goes on searching.
pub const TRIES: usize = 5;

/// Frames given to an encoder one after another, after it was reset.
pub struct Run {
    pub measurement: Measurement,
    pub column: String,
    /// Which run of its column.
    pub number: usize,
    /// What was drawn for it at random.
    pub detail: String,
    pub frames: Vec<Frame>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    Search,
    /// Good frames before a dropout.
    Good,
    Dropout,
    /// Good frames after it.
    Clear,
}

impl Phase {
    pub fn name(self) -> &'static str {
        match self {
            Phase::Search => "search",
            Phase::Good => "good",
            Phase::Dropout => "dropout",
            Phase::Clear => "clear",
        }
    }
}

/// A frame, and what the encoder made of it.
pub struct Frame {
    pub phase: Phase,
    pub file: String,
    /// PSNR of the clean frame and the render at its best known pose, dB; `None`: the prior is of another
    /// scene.
    pub best_psnr: Option<f64>,
    /// `None`: the encoder had no pose to start from.
    pub answer: Option<Answer>,
    /// Time to the frame's pose, render and difference; time to the error, if it fails.
    pub milliseconds: f64,
    /// Of a forward render at the best known pose just before.
    pub forward_ms: f64,
}

/// What the encoder says about a frame, and whether it is right.
pub struct Answer {
    /// PSNR of the clean frame and the render, dB.
    pub psnr: f64,
    pub certain: bool,
    pub frames_since_certain: u32,
    pub start: &'static str,
    /// Of all levels.
    pub renders: u32,
    pub full_renders: u32,
    /// Distance from the best known pose, in the prior's unit, and the angle, degrees.
    pub pose_error: [f64; 2],
    /// Whether that is too far, whatever the render looks like.
    pub elsewhere: bool,
}

impl Frame {
    /// How far the render is below that of the best known pose, dB.
    pub fn short(&self) -> Option<f64> {
        let (best, found) = (self.best_psnr?, self.answer.as_ref()?.psnr);
        // Both may be infinite.
        Some(if best == found { 0.0 } else { best - found })
    }

    pub fn found(&self) -> bool {
        // A figure that is no number has not been reached either.
        self.short().is_some_and(|short| short <= SHORT) && !self.elsewhere()
    }

    /// A pose in another scene is always wrong.
    pub fn wrong(&self) -> bool {
        let short = self.short().is_none_or(|short| !(short <= WRONG));
        self.answer.is_some() && (short || self.elsewhere())
    }

    fn elsewhere(&self) -> bool {
        self.answer.as_ref().is_some_and(|answer| answer.elsewhere)
    }

    pub fn certain(&self) -> bool {
        self.answer.as_ref().is_some_and(|answer| answer.certain)
    }

    pub fn false_certain(&self) -> bool {
        self.certain() && self.wrong()
    }

    pub fn no_start(&self) -> bool {
        self.answer.is_none()
    }

    pub fn in_forward_renders(&self) -> f64 {
        self.milliseconds / self.forward_ms
    }
}

/// A clean frame to be found.
#[derive(Clone, Copy)]
pub struct Target<'a> {
    pub shot: &'a Shot,
    pub best: &'a Best,
    /// The prior is of another scene.
    pub foreign: bool,
    /// Which pixels the frame shows, if not all: errors are of these.
    pub shown: Option<&'a [bool]>,
}

impl Target<'_> {
    /// PSNR of the clean frame and a render, dB.
    pub fn psnr(&self, render: &Picture) -> f64 {
        let clean = &self.shot.picture;
        match self.shown {
            Some(shown) => psnr_where(shown, clean, render),
            None => clean.psnr(render),
        }
    }
}

/// PSNR of two pictures over some of their pixels, dB.
pub fn psnr_where(shown: &[bool], a: &Picture, b: &Picture) -> f64 {
    let pixels = a.data.chunks_exact(3).zip(b.data.chunks_exact(3)).zip(shown);
    let (mut square, mut count) = (0.0, 0.0);
    for ((a, b), _) in pixels.filter(|(_, shown)| **shown) {
        let off = |c: usize| f64::from(a[c].abs_diff(b[c])) / 255.0;
        square += (0..3).map(|c| off(c).powi(2)).sum::<f64>();
        count += 3.0;
    }
    -10.0 * (square / count).log10()
}

/// An encoder that codes nothing, and the unit of its times.
pub struct Probe<'a> {
    encoder: Encoder,
    forward: &'a mut Forward,
}

impl<'a> Probe<'a> {
    /// A probe with the context's prior. Also returns the frames, as the context stays borrowed.
    pub fn new(context: &'a mut Context) -> anyhow::Result<(Probe<'a>, &'a [Shot], &'a [Best])> {
        let scene = context.scene.clone();
        Probe::of(context, &scene)
    }

    /// A probe with another prior.
    pub fn of(
        context: &'a mut Context,
        scene: &Arc<Scene>,
    ) -> anyhow::Result<(Probe<'a>, &'a [Shot], &'a [Best])> {
        let options = EncoderOptions { rate: None, ..context.options() };
        let camera = &context.shots[0].camera;
        let mut encoder = Encoder::new(&context.engine, scene, camera, options)?;
        // Renders the key frames and uses the commands once, before any trial. Else the first trials would differ from
        // the last ones.
        encoder.prepare(usize::MAX)?;
        encoder.encode(&context.shots[0].picture, Some(context.best[0].pose))?;
        let probe = Probe { encoder, forward: &mut context.forward };
        Ok((probe, &context.shots, &context.best))
    }

    pub fn reset(&mut self) {
        self.encoder.reset();
    }

    /// Gives the encoder a picture of the target as its next frame.
    pub fn frame(
        &mut self,
        phase: Phase,
        target: Target,
        given: &Picture,
        info: impl Into<FrameInfo>,
    ) -> anyhow::Result<Frame> {
        let Target { shot, best, foreign, .. } = target;
        let encoding = || format!("encoding {}", shot.file);
        self.encoder.set_camera(&shot.camera).with_context(encoding)?;
        let forward_ms = self.forward.measure(&shot.camera, &best.pose)?;
        let since = Instant::now();
        let encoded = match self.encoder.encode(given, info) {
            Err(Error::NoStart { .. }) => None,
            encoded => Some(encoded.with_context(encoding)?),
        };
        let elapsed = since.elapsed().as_secs_f64() * 1e3;
        let milliseconds = encoded.as_ref().map_or(elapsed, |e| e.stats.refine_milliseconds);
        let answer = encoded.map(|encoded| {
            let (stats, pose) = (&encoded.stats, &encoded.pose);
            let distance = (pose.centre() - best.pose.centre()).length();
            Answer {
                psnr: target.psnr(&encoded.render),
                certain: stats.certain,
                frames_since_certain: stats.frames_since_certain,
                start: stats.start.name(),
                renders: stats.renders.iter().sum(),
                full_renders: stats.full_renders,
                pose_error: [distance, pose.angle_to(&best.pose).to_degrees()],
                elsewhere: beyond(&best.pose, pose, stats.observability.length),
            }
        });
        let best_psnr = (!foreign).then_some(best.psnr);
        Ok(Frame { phase, file: shot.file.clone(), best_psnr, answer, milliseconds, forward_ms })
    }

    /// Resets the encoder and gives it the same picture up to [`TRIES`] times, until `done`.
    pub fn tries(
        &mut self,
        target: Target,
        given: &Picture,
        info: impl Into<FrameInfo>,
        done: fn(&Frame) -> bool,
    ) -> anyhow::Result<Vec<Frame>> {
        self.reset();
        let info = info.into();
        let mut frames: Vec<Frame> = Vec::new();
        while frames.len() < TRIES && !frames.last().is_some_and(done) {
            frames.push(self.frame(Phase::Search, target, given, info)?);
        }
        Ok(frames)
    }
}

#[cfg(test)]
pub mod tests {
    use super::*;

    /// A frame that stayed so far below a best known pose of 30 dB.
    pub fn frame(phase: Phase, short: f64, certain: bool) -> Frame {
        let answer = Answer {
            psnr: 30.0 - short,
            certain,
            frames_since_certain: 0,
            start: "external",
            renders: 4,
            full_renders: 2,
            pose_error: [0.0; 2],
            elsewhere: false,
        };
        Frame {
            phase,
            file: "a.png".into(),
            best_psnr: Some(30.0),
            answer: Some(answer),
            milliseconds: 50.0,
            forward_ms: 10.0,
        }
    }

    #[test]
    fn found_and_wrong_leave_room_between_them() {
        for (short, found, wrong) in [
            (-0.5, true, false),
            (0.0, true, false),
            (0.11, false, false),
            (0.99, false, false),
            (1.01, false, true),
            (f64::NAN, false, true),
            (f64::INFINITY, false, true),
        ] {
            for certain in [false, true] {
                let frame = frame(Phase::Search, short, certain);
                assert_eq!((frame.found(), frame.wrong()), (found, wrong), "{short}");
                assert_eq!(frame.false_certain(), wrong && certain, "{short}");
            }
        }
        let mut equal = frame(Phase::Search, f64::NEG_INFINITY, true);
        equal.best_psnr = Some(f64::INFINITY);
        assert!(equal.found() && !equal.wrong());
    }

    #[test]
    fn another_scene_and_no_answer_are_never_found() {
        let foreign = Frame { best_psnr: None, ..frame(Phase::Search, 0.0, true) };
        assert!(!foreign.found() && foreign.false_certain());
        let none = Frame { answer: None, ..frame(Phase::Search, 0.0, true) };
        assert!(none.no_start() && !none.found() && !none.wrong() && !none.certain());
    }
}
