//! Frames without any known pose, as after a restart of the vehicle's computer.

use nvsprior::Picture;

use super::super::context::{Best, Context, Shot};
use super::super::perturbed::even;
use super::Measurement;
use super::condition::Condition;
use super::probe::{Frame, Probe, Run, Target, psnr_where};
use super::roll;
use nvsprior_inputs::args::progress;

struct Rolled {
    shot: Shot,
    best: Best,
    degrees: f64,
    shown: Vec<bool>,
}

/// Looks for every frame, or for `trials` rolled copies, under each of some conditions.
pub fn measure(
    context: &mut Context,
    conditions: &[Condition],
    trials: usize,
) -> anyhow::Result<Vec<Run>> {
    let rolling = conditions.iter().any(|condition| condition.rolled());
    let rolled = rolled(context, if rolling { trials } else { 0 })?;
    let frames = context.shots.len();
    let count = |condition: Condition| if condition.rolled() { trials } else { frames };
    let bar = progress(conditions.iter().copied().map(count).sum(), "from nothing");
    let (mut probe, shots, best) = Probe::new(context)?;
    let mut runs = Vec::new();
    for &condition in conditions {
        for number in 0..count(condition) {
            let (shot, best, shown, detail) = if condition.rolled() {
                let Rolled { shot, best, degrees, shown } = &rolled[number];
                (shot, best, Some(&shown[..]), format!("rolled by {degrees:.4} degrees"))
            } else {
                (&shots[number], &best[number], None, String::new())
            };
            let given = condition.apply(&shot.picture, other(shots, number), number as u64);
            let target = Target { shot, best, foreign: false, shown };
            let frames = probe.tries(target, &given, None, Frame::found)?;
            let (measurement, column) = (Measurement::Nothing, condition.name().to_owned());
            runs.push(Run { measurement, column, number, detail, frames });
            bar.inc(1);
        }
    }
    Ok(runs)
}

/// A frame half a run away, of the same size if there is one.
fn other(shots: &[Shot], number: usize) -> &Picture {
    let own = &shots[number % shots.len()].picture;
    let far =
        (0..shots.len()).map(|i| &shots[(number + shots.len() / 2 + i) % shots.len()].picture);
    let same = |p: &&Picture| (p.width, p.height) == (own.width, own.height);
    far.into_iter().find(same).unwrap_or(own)
}

/// Rolled copies of the frames in turn, by up to 180° either way.
fn rolled(context: &mut Context, trials: usize) -> anyhow::Result<Vec<Rolled>> {
    let bar = progress(trials, "renders of rolled copies");
    let mut copies = Vec::new();
    for (number, share) in even(201).take(trials).enumerate() {
        let index = number % context.shots.len();
        let (from, angle) = (&context.shots[index], share * std::f64::consts::PI);
        let (picture, shown) = roll::picture(&from.camera, &from.picture, angle);
        let shot = Shot {
            file: from.file.clone(),
            name: from.name.clone(),
            camera: from.camera,
            picture,
            external: None,
            known: from.known.map(|pose| roll::pose(&pose, angle)),
            time: from.time,
        };
        let pose = roll::pose(&context.best[index].pose, angle);
        // The empty corners would change the best pose. So the frame's own best pose counts, rolled.
        let render = context.forward.picture(&shot.camera, &pose)?;
        let best = Best { pose, psnr: psnr_where(&shown, &shot.picture, render) };
        copies.push(Rolled { shot, best, degrees: angle.to_degrees(), shown });
        bar.inc(1);
    }
    Ok(copies)
}
