//! Frames of which nothing is known, as after the vehicle's computer has restarted.

use nvsprior::{Picture, Pose};

use super::super::context::{Best, Context, Shot};
use super::super::optimum::Searches;
use super::super::perturbed::even;
use super::Measurement;
use super::condition::Condition;
use super::probe::{Frame, Probe, Run, Target};
use super::roll;
use crate::args::progress;

/// A rolled copy of a frame.
struct Rolled {
    shot: Shot,
    best: Best,
    degrees: f64,
}

/// Looks for every frame, and for `trials` rolled copies, under each condition.
pub fn measure(context: &mut Context, trials: usize) -> anyhow::Result<Vec<Run>> {
    let rolled = rolled(context, trials)?;
    let frames = context.shots.len();
    let count = |condition: Condition| if condition.rolled() { trials } else { frames };
    let bar = progress(Condition::ALL.into_iter().map(count).sum(), "from nothing");
    let (mut probe, shots, best) = Probe::new(context)?;
    let mut runs = Vec::new();
    for condition in Condition::ALL {
        for number in 0..count(condition) {
            let (shot, best, detail) = if condition.rolled() {
                let Rolled { shot, best, degrees } = &rolled[number];
                (shot, best, format!("rolled by {degrees:.4} degrees"))
            } else {
                (&shots[number], &best[number], String::new())
            };
            let given = condition.apply(&shot.picture, other(shots, number), number as u64);
            let target = Target { shot, best, foreign: false };
            let frames = probe.tries(target, &given, None, Frame::found)?;
            let (measurement, column) = (Measurement::Nothing, condition.name().to_owned());
            runs.push(Run { measurement, column, number, detail, frames });
            bar.inc(1);
        }
    }
    bar.finish_and_clear();
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
fn rolled(context: &Context, trials: usize) -> anyhow::Result<Vec<Rolled>> {
    let mut searches = Searches::new(context)?;
    let bar = progress(trials, "best poses of rolled copies");
    let mut copies = Vec::new();
    for (number, share) in even(201).take(trials).enumerate() {
        let index = number % context.shots.len();
        let (from, angle) = (&context.shots[index], share * std::f64::consts::PI);
        let shot = Shot {
            file: from.file.clone(),
            camera: from.camera,
            picture: roll::picture(&from.camera, &from.picture, angle),
            external: None,
            known: from.known.map(|pose| roll::pose(&pose, angle)),
            time: from.time,
        };
        let best = roll::pose(&context.best[index].pose, angle);
        let starts: Vec<Pose> = shot.known.into_iter().chain([best]).collect();
        let best = searches.best(&shot, &starts)?;
        copies.push(Rolled { shot, best, degrees: angle.to_degrees() });
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(copies)
}
