//! From how far off a start leads to the best known pose.

use nvsprior::Hint;
use nvsprior::geometry::Twist;

use super::super::context::Context;
use super::super::perturbed::even;
use super::Measurement;
use super::probe::{Phase, Probe, Run, Target};
use nvsprior_inputs::args::progress;

/// Starts are moved off by at least this share of the figure.
const MIN_SHARE: f64 = 0.75;

/// How far starts are moved off, along or about one axis.
#[derive(Clone, Copy, Debug)]
enum Figure {
    Degrees(f64),
    /// The prior's unit.
    Units(f64),
}

const FIGURES: [Figure; 7] = [
    Figure::Degrees(10.0),
    Figure::Degrees(20.0),
    Figure::Degrees(30.0),
    Figure::Degrees(40.0),
    Figure::Units(0.5),
    Figure::Units(1.0),
    Figure::Units(1.58),
];

impl Figure {
    fn name(self) -> String {
        match self {
            Figure::Degrees(value) => format!("{value} degrees"),
            Figure::Units(value) => format!("{value} units"),
        }
    }

    /// A step by 75 to 100 % of the figure, of either sign, along or about a random axis. Also returns its name.
    fn step(self, drawn: &mut impl Iterator<Item = f64>) -> (Twist, String) {
        let mut next = || drawn.next().unwrap_or_default();
        let axis = (((next() + 1.0) * 1.5) as usize).min(2);
        let sign = next().signum();
        let share = sign * (MIN_SHARE + (1.0 - MIN_SHARE) * 0.5 * (next() + 1.0));
        let mut step = [0.0; 6];
        let name = ["x", "y", "z"][axis];
        let detail = match self {
            Figure::Degrees(value) => {
                step[3 + axis] = (share * value).to_radians();
                format!("{name} by {:.4} degrees", share * value)
            }
            Figure::Units(value) => {
                step[axis] = share * value;
                format!("{name} by {:.4} units", share * value)
            }
        };
        (step, detail)
    }
}

/// Encodes frames from `trials` starts per figure, spread over the frames in turn.
pub fn measure(context: &mut Context, trials: usize) -> anyhow::Result<Vec<Run>> {
    let (mut probe, shots, best) = Probe::new(context)?;
    let bar = progress(FIGURES.len() * trials, "starts put off");
    let mut runs = Vec::new();
    for (seed, figure) in FIGURES.into_iter().enumerate() {
        let mut drawn = even(101 + seed as u64);
        for number in 0..trials {
            let (shot, best) = (&shots[number % shots.len()], &best[number % shots.len()]);
            let (step, detail) = figure.step(&mut drawn);
            let hint = Hint::of(best.pose.stepped(&step));
            probe.reset();
            let target = Target { shot, best, foreign: false, shown: None };
            let frames = vec![probe.frame(Phase::Search, target, &shot.picture, hint)?];
            let (measurement, column) = (Measurement::Capture, figure.name());
            runs.push(Run { measurement, column, number, detail, frames });
            bar.inc(1);
        }
    }
    Ok(runs)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_along_one_axis_and_nearly_as_large_as_the_figure() {
        for figure in FIGURES {
            let mut drawn = even(1);
            let steps: Vec<Twist> = (0..300).map(|_| figure.step(&mut drawn).0).collect();
            let limit = match figure {
                Figure::Degrees(value) => value.to_radians(),
                Figure::Units(value) => value,
            };
            let mut counts = [[0; 2]; 6];
            for step in steps {
                let axes: Vec<usize> = (0..6).filter(|i| step[*i] != 0.0).collect();
                assert_eq!(axes.len(), 1);
                let value = step[axes[0]];
                assert!((MIN_SHARE..=1.0 + 1e-12).contains(&(value.abs() / limit)), "{value}");
                counts[axes[0]][usize::from(value < 0.0)] += 1;
            }
            let turns = matches!(figure, Figure::Degrees(_));
            let expected = if turns { 3..6 } else { 0..3 };
            for (axis, signs) in counts.iter().enumerate() {
                let inside = expected.contains(&axis);
                let good = |n: &i32| if inside { (30..75).contains(n) } else { *n == 0 };
                assert!(signs.iter().all(good), "{figure:?}: {counts:?}");
            }
        }
    }
}
