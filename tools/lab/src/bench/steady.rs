//! A steady run: the frames of a dive in order, one after the other and pipelined.

use std::time::Instant;

use nvsprior::{Encoded, EncoderOptions, Pipeline};
use nvsprior_paper::Optimizer;

use super::context::{Context, OptimizerRun, Sample, Shot};
use super::searcher::Searcher;

/// Encodes the first `frames` frames with one encoder. The first one, which is searched afresh,
/// does not count. `done` is told of each frame, and says whether to go on; one frame counts in any case.
pub fn measure(
    context: &mut Context,
    options: EncoderOptions,
    frames: usize,
    done: impl Fn() -> bool,
) -> anyhow::Result<Vec<Sample>> {
    let mut encoder = context.encoder(options)?;
    measure_by(context, &mut encoder, frames, done)
}

fn measure_by(
    context: &mut Context,
    encoder: &mut dyn Searcher,
    frames: usize,
    done: impl Fn() -> bool,
) -> anyhow::Result<Vec<Sample>> {
    let mut samples = Vec::new();
    for shot in 0..frames.min(context.shots.len()) {
        // If the first frame has no pose from outside, start from its best known pose, so that the run begins in the
        // same way.
        let start = context.shots[shot].external.or((shot == 0).then_some(context.best[0].pose));
        let sample = context.sample(encoder, shot, start)?;
        context.learn(&sample);
        samples.push(sample);
        if !done() && shot > 0 {
            break;
        }
    }
    samples.remove(0);
    Ok(samples)
}

pub fn descend(
    context: &mut Context,
    optimizer: Optimizer,
    frames: usize,
    done: impl Fn(),
) -> anyhow::Result<OptimizerRun> {
    let mut encoder = context.papers(optimizer)?;
    let done = || {
        done();
        true
    };
    Ok(OptimizerRun { optimizer, samples: measure_by(context, &mut encoder, frames, done)? })
}

/// Frames per second, without the first frame.
#[derive(Clone, Copy, serde::Serialize)]
pub struct Rates {
    /// One frame after the other.
    #[serde(rename = "frames_a_second")]
    pub latency: f64,
    /// One frame is coded while the next is searched for.
    #[serde(rename = "frames_a_second_pipelined")]
    pub pipelined: f64,
}

/// Measures both ways, without anything else between the frames.
pub fn rates(context: &Context) -> anyhow::Result<Rates> {
    Ok(Rates { latency: one_by_one(context)?, pipelined: pipelined(context)? })
}

fn one_by_one(context: &Context) -> anyhow::Result<f64> {
    let mut encoder = context.encoder(context.options())?;
    let (mut encoded, mut since) = (Encoded::default(), Instant::now());
    for (index, Shot { camera, picture, external, .. }) in context.shots.iter().enumerate() {
        encoder.set_camera(camera)?;
        let start = external.or((index == 0).then_some(context.best[0].pose));
        encoder.encode_into(picture, start, &mut encoded)?;
        if index == 0 {
            since = Instant::now();
        }
    }
    Ok((context.shots.len() - 1) as f64 / since.elapsed().as_secs_f64())
}

fn pipelined(context: &Context) -> anyhow::Result<f64> {
    let mut pipeline = Pipeline::new(context.encoder(context.options())?);
    let (mut encoded, mut since) = (Encoded::default(), Instant::now());
    for (index, Shot { camera, picture, external, .. }) in context.shots.iter().enumerate() {
        pipeline.encoder().set_camera(camera)?;
        let start = external.or((index == 0).then_some(context.best[0].pose));
        pipeline.push(picture, start, &mut encoded)?;
        if index == 0 {
            since = Instant::now();
        }
    }
    pipeline.flush(&mut encoded)?;
    // Counted: the searches of all frames but the first, and the coding of all.
    Ok((context.shots.len() - 1) as f64 / since.elapsed().as_secs_f64())
}
