//! Frames of one scene against the prior of another: the encoder must not be certain of any.

use nvsprior::Prior;

use super::super::context::Context;
use super::Measurement;
use super::probe::{Frame, Probe, Run, Target};
use nvsprior_inputs::args::progress;

/// Looks for every frame in another scene, from nothing and from its own pose.
pub fn measure(context: &mut Context, prior: &Prior) -> anyhow::Result<Vec<Run>> {
    let scene = context.engine.upload(prior)?;
    let (mut probe, shots, best) = Probe::of(context, &scene)?;
    let bar = progress(2 * shots.len(), "another scene");
    let mut runs = Vec::new();
    for (column, hinted) in [("from nothing", false), ("with hints", true)] {
        for (number, (shot, best)) in shots.iter().zip(best).enumerate() {
            let target = Target { shot, best, foreign: true, shown: None };
            let hint = shot.known.filter(|_| hinted);
            let frames = probe.tries(target, &shot.picture, hint, Frame::certain)?;
            let (measurement, column) = (Measurement::Foreign, column.to_owned());
            runs.push(Run { measurement, column, number, detail: String::new(), frames });
            bar.inc(1);
        }
    }
    Ok(runs)
}
