//! `nvsprior-lab frame-times`: most and 99 % of frame times, without a bound and with one.

use std::path::Path;
use std::time::Duration;

use nvsprior::{Encoder, EncoderOptions, Picture, Pose};
use nvsprior_inputs::args::progress;
use nvsprior_inputs::values;
use serde::Serialize;

use super::RunArgs;
use super::context::Context;
use super::recovery::pixels;
use nvsprior_inputs::report::{Table, fixed, fixed_or_empty, write_json};
use nvsprior_inputs::statistics::{at, median};

/// Measure the times of frames: lost, found, in darkness, in silt, and found again
///
/// Four runs, from places spread over the frames. Each begins with no pose and no key frame rendered. Without a bound,
/// then with one. Writes frame-times.json.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    run: RunArgs,
    /// The bound [default: four times the median of the frames that others lead to]
    #[arg(long, value_name = "MS", value_parser = values::milliseconds)]
    bound: Option<Duration>,
}

/// Places at which runs begin.
const RUNS: usize = 4;

/// What a frame is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum Phase {
    Lost,
    Found,
    Darkness,
    Silt,
    FoundAgain,
}

impl Phase {
    const ALL: [Phase; 5] =
        [Phase::Lost, Phase::Found, Phase::Darkness, Phase::Silt, Phase::FoundAgain];

    fn name(self) -> &'static str {
        match self {
            Phase::Lost => "lost",
            Phase::Found => "found",
            Phase::Darkness => "darkness",
            Phase::Silt => "silt",
            Phase::FoundAgain => "found again",
        }
    }
}

/// The frames of a run, and how many of each.
const RUN: [(Phase, usize); 6] = [
    (Phase::Lost, 6),
    (Phase::Found, 6),
    (Phase::Darkness, 4),
    (Phase::FoundAgain, 4),
    (Phase::Silt, 4),
    (Phase::FoundAgain, 4),
];

/// Times of the frames of one phase, milliseconds.
#[derive(Serialize)]
struct Row {
    phase: Phase,
    /// `None`: none.
    bound_ms: Option<f64>,
    frames: usize,
    median_ms: f64,
    p99_ms: f64,
    most_ms: f64,
    /// Frames that took longer than the bound.
    over: usize,
    /// Frames whose search the clock ended.
    out_of_time: usize,
    certain: usize,
}

/// A frame: what it is about, its time in milliseconds, whether the clock ended it, and whether it is certain.
type Timed = (Phase, f64, bool, bool);

/// Measures, prints and writes it all to a folder.
pub fn run(args: &Args) -> anyhow::Result<()> {
    args.run.measured(|context, folder| times(args.bound, context, folder))
}

fn times(bound: Option<Duration>, context: &mut Context, folder: &Path) -> anyhow::Result<()> {
    context.one_size("this command")?;
    let free = measure(context, None)?;
    let steady = free.iter().filter(|frame| frame.0 == Phase::Found).map(|frame| frame.1);
    let usual = Duration::from_secs_f64(4.0 * median(steady) / 1e3);
    let bound = bound.unwrap_or(usual);
    let bounded = measure(context, Some(bound))?;
    let mut rows = rows(&free, None);
    rows.extend(self::rows(&bounded, Some(bound)));
    let table = Table::of(
        &rows,
        &[
            ("frames", &|row| format!("{} {}", row.frames, row.phase.name())),
            ("bound, ms", &|row| fixed_or_empty(row.bound_ms, 0)),
            ("median", &|row| fixed(row.median_ms, 1)),
            ("99 %", &|row| fixed(row.p99_ms, 1)),
            ("most", &|row| fixed(row.most_ms, 1)),
            ("over", &|row| row.over.to_string()),
            ("out of time", &|row| row.out_of_time.to_string()),
            ("certain", &|row| row.certain.to_string()),
        ],
    );
    table.print();
    write_json(&folder.join("frame-times.json"), &rows)
}

fn measure(context: &Context, frame_time: Option<Duration>) -> anyhow::Result<Vec<Timed>> {
    let bar = progress(RUNS, "frame times");
    let mut frames = Vec::new();
    for number in 0..RUNS {
        // Key frames are rendered anew in each run.
        let options = EncoderOptions { frame_time, ..context.options() };
        let mut encoder = context.encoder(options)?;
        let place = number * context.shots.len() / RUNS;
        one_run(context, &mut encoder, place, &mut frames)?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(frames)
}

/// Goes through a run from a place. The first frame does not count, as the driver may compile in it.
fn one_run(
    context: &Context,
    encoder: &mut Encoder,
    place: usize,
    frames: &mut Vec<Timed>,
) -> anyhow::Result<()> {
    let mut number = 0;
    for (phase, count) in RUN {
        for _ in 0..count {
            let shot = &context.shots[(place + number) % context.shots.len()];
            let seed = 301 + number as u64;
            let empty: Option<Picture> = match phase {
                Phase::Darkness => Some(pixels::empty(&shot.camera, 0.0, 1.0 / 255.0, seed)),
                Phase::Silt => Some(pixels::empty(&shot.camera, 0.45, 0.02, seed)),
                _ => None,
            };
            let encoded = encoder.encode(empty.as_ref().unwrap_or(&shot.picture), None::<Pose>)?;
            let stats = encoded.stats;
            if number > 0 {
                frames.push((phase, stats.milliseconds, stats.out_of_time, stats.certain));
            }
            number += 1;
        }
    }
    Ok(())
}

fn rows(frames: &[Timed], bound: Option<Duration>) -> Vec<Row> {
    let bound_ms = bound.map(|bound| bound.as_secs_f64() * 1e3);
    let row = |phase: Phase| {
        let own: Vec<&Timed> = frames.iter().filter(|frame| frame.0 == phase).collect();
        let mut times: Vec<f64> = own.iter().map(|frame| frame.1).collect();
        times.sort_by(f64::total_cmp);
        Row {
            phase,
            bound_ms,
            frames: own.len(),
            median_ms: at(&times, 0.5),
            p99_ms: at(&times, 0.99),
            most_ms: at(&times, 1.0),
            over: times.iter().filter(|time| bound_ms.is_some_and(|most| **time > most)).count(),
            out_of_time: own.iter().filter(|frame| frame.2).count(),
            certain: own.iter().filter(|frame| frame.3).count(),
        }
    };
    Phase::ALL.map(row).into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_over_the_bound_are_counted() {
        let frames = [10.0, 20.0, 30.0].map(|time| (Phase::Silt, time, time > 15.0, false));
        let rows = rows(&frames, Some(Duration::from_millis(20)));
        let silt = rows.iter().find(|row| row.phase == Phase::Silt).unwrap();
        assert_eq!((silt.frames, silt.over, silt.out_of_time, silt.certain), (3, 1, 2, 0));
        assert_eq!((silt.median_ms, silt.most_ms), (20.0, 30.0));
        assert_eq!(rows[0].frames, 0);
    }
}
