//! Starts moved off from the best known poses. Each frame is searched as if nothing were known before.

use nvsprior::EncoderOptions;

use super::context::{Context, Sample};
use super::perturbed::{Magnitude, steps};

const SEED: u64 = 1;

/// Encodes frames from `trials` starts, spread over the frames in turn. `done` is told of each start, and says whether
/// to go on.
pub fn measure(
    context: &mut Context,
    magnitude: Magnitude,
    trials: usize,
    done: impl Fn() -> bool,
) -> anyhow::Result<Vec<Sample>> {
    let mut encoder = context.encoder(EncoderOptions { rate: None, ..context.options() })?;
    // All steps refer to the poses known now: better poses found on the way move none.
    let poses: Vec<_> = context.best.iter().map(|best| best.pose).collect();
    // Not counted: the first use of the commands.
    context.sample(&mut encoder, 0, Some(poses[0]))?;
    let mut samples = Vec::new();
    for (trial, step) in steps(magnitude, SEED).take(trials).enumerate() {
        let shot = trial % poses.len();
        encoder.reset();
        let sample = context.sample(&mut encoder, shot, Some(poses[shot].stepped(&step)))?;
        context.learn(&sample);
        samples.push(sample);
        if !done() {
            break;
        }
    }
    Ok(samples)
}
