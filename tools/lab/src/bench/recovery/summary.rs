//! The runs by column: counts and spreads, as JSON.

use std::path::Path;

use anyhow::Context as _;
use serde_json::{Map, Value, json};

use super::super::context::{Best, Context, Shot};
use super::super::perturbed::SHORT;
use super::super::statistics::{Spread, median};
use super::dropouts::CLEAR;
use super::probe::{Answer, Frame, Phase, Run};
use super::{Measurement, TRIES, WRONG};

/// Trials whose outcome is listed one by one.
pub const EARLY: usize = 8;

/// The figures of a column. Counts are of trials, unless they are of frames.
#[derive(Debug, PartialEq)]
pub struct Column {
    pub measurement: Measurement,
    pub name: String,
    pub trials: usize,
    /// Trials found at the first frame; after a dropout: found and certain at the first clear frame.
    pub found_first: usize,
    /// Found at the first frame, of the first [`EARLY`] trials.
    pub found_early: usize,
    /// Found at any frame; after a dropout, at any clear one, and certain.
    pub found: usize,
    /// Certain at the first frame; after a dropout, at the first clear one.
    pub certain_first: usize,
    /// Certain at any frame; after a dropout, at any clear one.
    pub certain: usize,
    /// Certain of a wrong pose at any frame.
    pub false_certain: usize,
    /// At the first frame; after a dropout, at the first clear one.
    pub false_certain_first: usize,
    /// Frames of which the encoder was certain, although its pose was wrong.
    pub false_certain_frames: usize,
    /// The false certain frames of dropouts.
    pub false_certain_dropout: usize,
    /// Frames of a dropout of which it was certain.
    pub certain_dropout: usize,
    /// Runs whose last frame before the dropout was found.
    pub good: usize,
    /// Frames for which there was no pose to start from.
    pub no_start: usize,
    /// Frames found that are more than 0.1 dB better than the best known pose.
    pub better: usize,
    pub frames: usize,
    /// Over all frames for which the encoder had an answer, except those before a dropout.
    pub renders: Spread,
    pub full_renders: Spread,
    /// Over all frames except those before a dropout.
    pub milliseconds: Spread,
    pub in_forward_renders: Spread,
    /// Frames until found; 1 is the first (after a dropout, the first clear one), infinite means never.
    pub until_found: Vec<f64>,
}

/// All columns, in order of their first runs.
pub fn columns(runs: &[Run]) -> Vec<Column> {
    let same = |a: &Run, b: &Run| a.measurement == b.measurement && a.column == b.column;
    runs.chunk_by(same).map(Column::of).collect()
}

/// Frames in which the pose is to be found.
fn sought(run: &Run) -> impl Iterator<Item = &Frame> {
    run.frames.iter().filter(|frame| matches!(frame.phase, Phase::Search | Phase::Clear))
}

/// Whether a frame ends the search.
fn found(frame: &Frame) -> bool {
    frame.found() && (frame.phase != Phase::Clear || frame.certain())
}

impl Column {
    /// Summarises runs of the same column; at least one.
    fn of(runs: &[Run]) -> Column {
        let count = |is: &dyn Fn(&Run) -> bool| runs.iter().filter(|run| is(run)).count();
        let first = |is: fn(&Frame) -> bool| count(&|run| sought(run).next().is_some_and(is));
        let any = |is: fn(&Frame) -> bool| count(&|run| sought(run).any(is));
        let frames = || runs.iter().flat_map(|run| &run.frames);
        let of = |is: &dyn Fn(&Frame) -> bool| frames().filter(|frame| is(frame)).count();
        let dropout = |frame: &Frame| frame.phase == Phase::Dropout;
        let timed = || frames().filter(|frame| frame.phase != Phase::Good);
        let answers = |figure: fn(&Answer) -> u32| {
            let answers = timed().filter_map(|frame| frame.answer.as_ref());
            Spread::of(answers.map(|answer| f64::from(figure(answer))))
        };
        let until =
            |run| sought(run).position(found).map_or(f64::INFINITY, |index| (index + 1) as f64);
        let good = |run: &Run| {
            let last = run.frames.iter().rfind(|frame| frame.phase == Phase::Good);
            last.is_some_and(Frame::found)
        };
        let early = &runs[..EARLY.min(runs.len())];
        Column {
            measurement: runs[0].measurement,
            name: runs[0].column.clone(),
            trials: runs.len(),
            found_first: first(found),
            found_early: early.iter().filter(|run| sought(run).next().is_some_and(found)).count(),
            found: any(found),
            certain_first: first(Frame::certain),
            certain: any(Frame::certain),
            false_certain: count(&|run| run.frames.iter().any(Frame::false_certain)),
            false_certain_first: first(Frame::false_certain),
            false_certain_frames: of(&Frame::false_certain),
            false_certain_dropout: of(&|frame| dropout(frame) && frame.false_certain()),
            certain_dropout: of(&|frame| dropout(frame) && frame.certain()),
            good: count(&good),
            no_start: of(&Frame::no_start),
            better: of(&|frame| frame.short().is_some_and(|short| short < -SHORT)),
            frames: frames().count(),
            renders: answers(|answer| answer.renders),
            full_renders: answers(|answer| answer.full_renders),
            milliseconds: Spread::of(timed().map(|frame| frame.milliseconds)),
            in_forward_renders: Spread::of(timed().map(Frame::in_forward_renders)),
            until_found: runs.iter().map(until).collect(),
        }
    }

    /// Trials at whose first frame the encoder was not certain.
    pub fn uncertain_first(&self) -> usize {
        self.trials - self.certain_first
    }

    fn json(&self) -> Value {
        let share = |count: usize| count as f64 / self.trials as f64;
        let mut figures = json!({
            "column": self.name,
            "trials": self.trials,
            "frames": self.frames,
            "found_first": self.found_first,
            "found": self.found,
            "share_found_first": share(self.found_first),
            "share_found": share(self.found),
            "certain_first": self.certain_first,
            "certain": self.certain,
            "share_uncertain_first": share(self.uncertain_first()),
            "false_certain": self.false_certain,
            "false_certain_first": self.false_certain_first,
            "false_certain_frames": self.false_certain_frames,
            "no_start_frames": self.no_start,
            "better_than_best_frames": self.better,
            "renders": self.renders.json(),
            "full_renders": self.full_renders.json(),
            "milliseconds": self.milliseconds.json(),
            "in_forward_renders": self.in_forward_renders.json(),
        });
        // `null`: never.
        let until = json!({ "until_found": self.until_found });
        let more = match self.measurement {
            Measurement::Capture => {
                json!({ "early": EARLY.min(self.trials), "found_early": self.found_early })
            }
            Measurement::Nothing => until,
            Measurement::Dropouts => json!({
                "until_found": self.until_found,
                "found_before": self.good,
                "certain_dropout_frames": self.certain_dropout,
                "false_certain_dropout_frames": self.false_certain_dropout,
            }),
            Measurement::Foreign => json!({}),
        };
        if let (Value::Object(figures), Value::Object(more)) = (&mut figures, more) {
            figures.extend(more);
        }
        figures
    }
}

/// Writes the summary.
pub fn write(path: &Path, context: &Context, columns: &[Column]) -> anyhow::Result<()> {
    let camera = &context.shots[0].camera;
    let best = |(shot, best): (&Shot, &Best)| json!({ "file": shot.file, "psnr": best.psnr });
    let mut root = Map::new();
    let mut put = |name: &str, value: Value| root.insert(name.into(), value);
    put("device", json!(context.engine.device().to_string()));
    put("frames", json!(context.shots.len()));
    put("size", json!([camera.width, camera.height]));
    put("splats", json!(context.prior.splats().len()));
    put("key_frames", json!(context.prior.key_frames().len()));
    put("forward_render_ms", json!(median(context.forward.times.iter().copied())));
    put("found_within_db", json!(SHORT));
    put("wrong_beyond_db", json!(WRONG));
    put("tries", json!(TRIES));
    put("clear_frames", json!(CLEAR));
    put("best_known", context.shots.iter().zip(&context.best).map(best).collect());
    for measurement in Measurement::ALL {
        let of = columns.iter().filter(|column| column.measurement == measurement);
        put(measurement.name(), of.map(Column::json).collect());
    }
    std::fs::write(path, serde_json::to_string_pretty(&root)? + "\n")
        .with_context(|| format!("writing {}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::super::probe::tests::frame;
    use super::*;

    fn run(measurement: Measurement, frames: Vec<Frame>) -> Run {
        let (column, detail) = ("column".to_owned(), String::new());
        Run { measurement, column, number: 0, detail, frames }
    }

    #[test]
    fn tries_are_counted_by_trial_and_by_frame() {
        let search = |short, certain| frame(Phase::Search, short, certain);
        let none = Frame { answer: None, ..search(0.0, false) };
        let runs = [
            run(Measurement::Nothing, vec![search(0.0, true)]),
            run(Measurement::Nothing, vec![none, search(5.0, true), search(0.05, false)]),
            run(Measurement::Nothing, vec![search(5.0, false), search(9.0, false)]),
        ];
        let columns = columns(&runs);
        let column = &columns[0];
        assert_eq!((columns.len(), column.trials, column.frames), (1, 3, 6));
        assert_eq!((column.found_first, column.found), (1, 2));
        assert_eq!((column.certain_first, column.certain, column.uncertain_first()), (1, 2, 2));
        assert_eq!((column.false_certain, column.false_certain_first), (1, 0));
        assert_eq!((column.false_certain_frames, column.no_start), (1, 1));
        assert_eq!(column.until_found, [1.0, 3.0, f64::INFINITY]);
        assert_eq!(column.json()["until_found"], json!([1.0, 3.0, null]));
        assert_eq!((column.in_forward_renders.median, column.full_renders.p95), (5.0, 2.0));
    }

    #[test]
    fn after_dropouts_clear_frames_count_that_are_found_and_certain() {
        use Phase::{Clear, Dropout, Good};
        let of = |frames: &[(Phase, f64, bool)]| {
            let frames =
                frames.iter().map(|(phase, short, certain)| frame(*phase, *short, *certain));
            run(Measurement::Dropouts, frames.collect())
        };
        let runs = [
            of(&[
                (Good, 0.0, true),
                (Dropout, 3.0, true),
                (Dropout, 0.0, true),
                (Clear, 0.0, true),
            ]),
            of(&[
                (Good, 2.0, true),
                (Dropout, 3.0, false),
                (Clear, 0.0, false),
                (Clear, 0.0, true),
            ]),
        ];
        let column = &columns(&runs)[0];
        assert_eq!((column.found_first, column.found, column.good), (1, 2, 1));
        assert_eq!((column.certain_dropout, column.false_certain_dropout), (2, 1));
        // The frame before the dropout was one, too.
        assert_eq!((column.false_certain, column.false_certain_frames), (2, 2));
        assert_eq!(column.until_found, [1.0, 2.0]);
    }
}
