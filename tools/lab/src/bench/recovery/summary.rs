//! The runs by column: counts and spreads, as JSON.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;

use super::super::context::Context;
use super::super::perturbed::SHORT;
use super::super::report::{About, BestPsnr};
use super::Measurement;
use super::dropouts::CLEAR;
use super::probe::{Answer, Frame, Phase, Run, TRIES, WRONG};
use nvsprior_inputs::report::write_json;
use nvsprior_inputs::statistics::Spread;

/// Trials whose outcome is listed one by one.
pub const EARLY: usize = 8;

/// The figures of a column. Counts are of trials, unless they are of frames.
#[derive(Debug, PartialEq, Serialize)]
pub struct Column {
    #[serde(skip)]
    pub measurement: Measurement,
    #[serde(rename = "column")]
    pub name: String,
    pub trials: usize,
    pub frames: usize,
    /// Trials found at the first frame; after a dropout: found and certain at the first clear frame.
    pub found_first: usize,
    /// Found at any frame; after a dropout, at any clear one, and certain.
    pub found: usize,
    share_found_first: f64,
    share_found: f64,
    /// Certain at the first frame; after a dropout, at the first clear one.
    pub certain_first: usize,
    /// Certain at any frame; after a dropout, at any clear one.
    pub certain: usize,
    share_uncertain_first: f64,
    /// Certain of a wrong pose at any frame.
    pub false_certain: usize,
    /// At the first frame; after a dropout, at the first clear one.
    pub false_certain_first: usize,
    /// Frames of which the encoder was certain, although its pose was wrong.
    false_certain_frames: usize,
    /// Frames for which there was no pose to start from.
    #[serde(rename = "no_start_frames")]
    pub no_start: usize,
    /// Frames found that are more than 0.1 dB better than the best known pose.
    better_than_best_frames: usize,
    /// Over all frames for which the encoder had an answer, except those before a dropout.
    renders: Spread,
    pub full_renders: Spread,
    /// Over all frames except those before a dropout.
    milliseconds: Spread,
    pub in_forward_renders: Spread,
    /// Of starts moved off.
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    pub early: Option<Early>,
    /// Frames until found; 1 is the first (after a dropout, the first clear one), infinite means never. Of frames from
    /// nothing, and of dropouts.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub until_found: Vec<f64>,
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    pub dropout: Option<DropoutFigures>,
}

/// The first [`EARLY`] trials.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Early {
    pub early: usize,
    /// Found at the first frame.
    pub found_early: usize,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct DropoutFigures {
    /// Runs whose last frame before the dropout was found.
    pub found_before: usize,
    /// Frames of a dropout of which the encoder was certain.
    pub certain_dropout_frames: usize,
    /// Those of them whose pose was wrong.
    pub false_certain_dropout_frames: usize,
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
        let (trials, measurement) = (runs.len(), runs[0].measurement);
        let share = |count: usize| count as f64 / trials as f64;
        let (found_first, all_found) = (first(found), any(found));
        let certain_first = first(Frame::certain);
        let early = &runs[..EARLY.min(trials)];
        let early = Early {
            early: early.len(),
            found_early: early.iter().filter(|run| sought(run).next().is_some_and(found)).count(),
        };
        let dropout = DropoutFigures {
            found_before: count(&good),
            certain_dropout_frames: of(&|frame| dropout(frame) && frame.certain()),
            false_certain_dropout_frames: of(&|frame| dropout(frame) && frame.false_certain()),
        };
        let has_until = matches!(measurement, Measurement::Nothing | Measurement::Dropouts);
        Column {
            measurement,
            name: runs[0].column.clone(),
            trials,
            frames: frames().count(),
            found_first,
            found: all_found,
            share_found_first: share(found_first),
            share_found: share(all_found),
            certain_first,
            certain: any(Frame::certain),
            share_uncertain_first: share(trials - certain_first),
            false_certain: count(&|run| run.frames.iter().any(Frame::false_certain)),
            false_certain_first: first(Frame::false_certain),
            false_certain_frames: of(&Frame::false_certain),
            no_start: of(&Frame::no_start),
            better_than_best_frames: of(&|f| f.short().is_some_and(|short| short < -SHORT)),
            renders: answers(|answer| answer.renders),
            full_renders: answers(|answer| answer.full_renders),
            milliseconds: Spread::of(timed().map(|frame| frame.milliseconds)),
            in_forward_renders: Spread::of(timed().map(Frame::in_forward_renders)),
            early: (measurement == Measurement::Capture).then_some(early),
            until_found: if has_until { runs.iter().map(until).collect() } else { Vec::new() },
            dropout: (measurement == Measurement::Dropouts).then_some(dropout),
        }
    }

    /// Trials at whose first frame the encoder was not certain.
    pub fn uncertain_first(&self) -> usize {
        self.trials - self.certain_first
    }
}

#[derive(Serialize)]
struct Root<'a> {
    #[serde(flatten)]
    about: About,
    key_frames: usize,
    found_within_db: f64,
    wrong_beyond_db: f64,
    tries: usize,
    clear_frames: usize,
    best_known: Vec<BestPsnr<'a>>,
    #[serde(flatten)]
    measurements: BTreeMap<&'static str, Vec<&'a Column>>,
}

pub fn write(path: &Path, context: &Context, columns: &[Column]) -> anyhow::Result<()> {
    let of = |measurement: Measurement| {
        let of = columns.iter().filter(|column| column.measurement == measurement);
        (measurement.name(), of.collect())
    };
    let root = Root {
        about: About::of(context),
        key_frames: context.prior.key_frames().len(),
        found_within_db: SHORT,
        wrong_beyond_db: WRONG,
        tries: TRIES,
        clear_frames: CLEAR,
        best_known: BestPsnr::all(context),
        measurements: Measurement::ALL.map(of).into(),
    };
    write_json(path, &root)
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
        let value = serde_json::to_value(column).unwrap();
        assert_eq!(value["until_found"], serde_json::json!([1.0, 3.0, null]));
        assert!(value.get("found_early").is_none() && value.get("found_before").is_none());
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
        assert_eq!((column.found_first, column.found), (1, 2));
        let expected = DropoutFigures {
            found_before: 1,
            certain_dropout_frames: 2,
            false_certain_dropout_frames: 1,
        };
        assert_eq!(column.dropout, Some(expected));
        // The frame before the dropout was one, too.
        assert_eq!((column.false_certain, column.false_certain_frames), (2, 2));
        assert_eq!(column.until_found, [1.0, 2.0]);
    }
}
