//! Frames that show nothing, in the middle of a run. Measures when the camera is found again.

use nvsprior::{FrameInfo, Hint, Picture};

use super::super::context::{Best, Context, Shot};
use super::Measurement;
use super::pixels;
use super::probe::{Phase, Probe, Run, Target};
use nvsprior_inputs::args::progress;
use nvsprior_inputs::statistics::median;

/// Frames before the dropout.
const GOOD: usize = 4;
/// Frames after it within which the camera must be found again.
pub const CLEAR: usize = 30;
/// Frames per second that the encoder gets.
const RATES: [f64; 2] = [3.0, 15.0];

/// What the frames of a dropout show.
#[derive(Clone, Copy, Debug)]
enum Outage {
    /// Grey 0.45, noise of deviation 0.02.
    Silt,
    /// Black, noise of one 8-bit step.
    Blackout,
}

impl Outage {
    fn name(self) -> &'static str {
        match self {
            Outage::Silt => "silt",
            Outage::Blackout => "blackout",
        }
    }

    /// The frame of this number in the dropout, the same in every dropout.
    fn picture(self, shot: &Shot, number: usize) -> Picture {
        let seed = 301 + number as u64;
        match self {
            Outage::Silt => pixels::empty(&shot.camera, 0.45, 0.02, seed),
            Outage::Blackout => pixels::empty(&shot.camera, 0.0, 1.0 / 255.0, seed),
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct Case {
    outage: Outage,
    length: usize,
    /// Frames per second that the encoder gets.
    rate: f64,
    /// Whether the camera file's pose goes with every frame. Else with the first one only.
    hints: bool,
}

impl Case {
    fn all(lengths: &[usize]) -> Vec<Case> {
        let mut cases = Vec::new();
        for outage in [Outage::Silt, Outage::Blackout] {
            for hints in [false, true] {
                for rate in RATES {
                    let case = |length: &usize| Case { outage, length: *length, rate, hints };
                    cases.extend(lengths.iter().map(case));
                }
            }
        }
        cases
    }

    fn name(&self) -> String {
        let hints = if self.hints { "with" } else { "without" };
        let (outage, length, rate) = (self.outage.name(), self.length, self.rate);
        format!("{outage} of {length} at {rate}/s {hints} hints")
    }

    fn phase(&self, n: usize) -> Phase {
        match n {
            _ if n < GOOD => Phase::Good,
            _ if n < GOOD + self.length => Phase::Dropout,
            _ => Phase::Clear,
        }
    }
}

/// Which frame of a run the vehicle is at if it goes back and forth along the run.
fn folded(place: usize, frames: usize) -> usize {
    let round = place % (2 * (frames - 1)).max(1);
    round.min((2 * (frames - 1)).saturating_sub(round))
}

/// Frames per second of the run, from the median gap between frames, if their times are known.
fn own_rate(shots: &[Shot], unknown: f64) -> f64 {
    let times: Option<Vec<f64>> = shots.iter().map(|shot| shot.time).collect();
    let gap = median(times.unwrap_or_default().windows(2).map(|pair| pair[1] - pair[0]));
    if gap > 0.0 { 1.0 / gap } else { unknown }
}

/// Measures each case from several places of the run. `unknown`: frames per second of the run, if their times are not
/// known.
pub fn measure(
    context: &mut Context,
    lengths: &[usize],
    places: usize,
    unknown: f64,
) -> anyhow::Result<Vec<Run>> {
    let (mut probe, shots, best) = Probe::new(context)?;
    let own_rate = own_rate(shots, unknown);
    let cases = Case::all(lengths);
    let bar = progress(cases.len() * places, "dropouts");
    let mut runs = Vec::new();
    for case in cases {
        for number in 0..places {
            let place = number * shots.len() / places;
            let step = own_rate / case.rate;
            let at = |n: usize| folded(place + (n as f64 * step).round() as usize, shots.len());
            let run = sequence(&mut probe, shots, best, &case, at)?;
            let detail = format!("from {}", shots[place].file);
            runs.push(Run { number, detail, ..run });
            bar.inc(1);
        }
    }
    Ok(runs)
}

/// Measures one dropout. `at`: the vehicle's place in the run at a frame.
fn sequence(
    probe: &mut Probe,
    shots: &[Shot],
    best: &[Best],
    case: &Case,
    at: impl Fn(usize) -> usize,
) -> anyhow::Result<Run> {
    probe.reset();
    let mut frames = Vec::new();
    for n in 0..GOOD + case.length + CLEAR {
        let (shot, phase) = (&shots[at(n)], case.phase(n));
        let empty = (phase == Phase::Dropout).then(|| case.outage.picture(shot, n - GOOD));
        let hint = shot.known.filter(|_| case.hints || n == 0).map(Hint::of);
        let known = FrameInfo { hint, time: Some(n as f64 / case.rate) };
        let target = Target { shot, best: &best[at(n)], foreign: false, shown: None };
        let frame = probe.frame(phase, target, empty.as_ref().unwrap_or(&shot.picture), known)?;
        let again = phase == Phase::Clear && frame.found() && frame.certain();
        frames.push(frame);
        if again {
            break;
        }
    }
    let (measurement, column) = (Measurement::Dropouts, case.name());
    Ok(Run { measurement, column, number: 0, detail: String::new(), frames })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_vehicle_goes_back_and_forth() {
        let places: Vec<usize> = (0..8).map(|place| folded(place, 4)).collect();
        assert_eq!(places, [0, 1, 2, 3, 2, 1, 0, 1]);
        assert_eq!([0, 1, 2, 3].map(|place| folded(place, 2)), [0, 1, 0, 1]);
        assert_eq!([0, 1, 2].map(|place| folded(place, 1)), [0, 0, 0]);
    }

    #[test]
    fn phases_follow_one_another() {
        let cases = Case::all(&[1, 4]);
        assert_eq!(cases.len(), 2 * 2 * 2 * 2);
        let phases: Vec<Phase> = (0..8).map(|n| cases[0].phase(n)).collect();
        let expected =
            [[Phase::Good; 4], [Phase::Dropout, Phase::Clear, Phase::Clear, Phase::Clear]];
        assert_eq!(phases, expected.concat());
        let mut names: Vec<String> = cases.iter().map(Case::name).collect();
        names.dedup();
        assert_eq!(names.len(), cases.len());
    }
}
