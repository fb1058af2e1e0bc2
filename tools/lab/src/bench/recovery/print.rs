//! The columns as text.

use super::super::context::Context;
use super::super::statistics::{Spread, median};
use super::dropouts::CLEAR;
use super::summary::{Column, EARLY};
use super::{Measurement, TRIES};

/// Prints one table per measurement.
pub fn print(context: &Context, columns: &[Column]) {
    let (shots, prior) = (context.shots.len(), &context.prior);
    let (splats, key_frames) = (prior.splats().len(), prior.key_frames().len());
    println!("{}", context.engine.device());
    println!("{shots} frames, {splats} splats, {key_frames} key frames");
    let best = median(context.best.iter().map(|best| best.psnr));
    println!("best known poses: {best:.2} dB in the median");
    for measurement in Measurement::ALL {
        let of: Vec<_> = columns.iter().filter(|c| c.measurement == measurement).collect();
        if of.is_empty() {
            continue;
        }
        match measurement {
            Measurement::Capture => capture(&of),
            Measurement::Nothing => nothing(&of),
            Measurement::Dropouts => dropouts(&of),
            Measurement::Foreign => foreign(&of),
        }
    }
}

fn spread(spread: &Spread) -> String {
    let Spread { median, p95, .. } = spread;
    // Of no value at all.
    if median.is_nan() { "none".to_owned() } else { format!("{median:.1}, {p95:.1}") }
}

fn of(count: usize, all: usize) -> String {
    format!("{count}/{all}")
}

fn capture(columns: &[&Column]) {
    println!(
        "\ncapture: starts moved off by 75 to 100 % of the figure; renders: full ones; median, 95 %"
    );
    let first = format!("first {EARLY}");
    println!(
        "{:14} {first:>8} {:>9} {:>9} {:>13} {:>14} {:>14}",
        "put off by", "found", "uncertain", "false certain", "renders", "forward"
    );
    for c in columns {
        println!(
            "{:14} {:>8} {:>9} {:>9} {:13} {:>14} {:>14}",
            c.name,
            of(c.found_early, EARLY.min(c.trials)),
            of(c.found_first, c.trials),
            c.uncertain_first(),
            c.false_certain,
            spread(&c.full_renders),
            spread(&c.in_forward_renders),
        );
    }
}

fn nothing(columns: &[&Column]) {
    println!("\nnothing: no pose; trials found at the first frame, and within {TRIES} of the same");
    println!("certain, false certain: at the first frame, at any; no start: frames");
    println!(
        "{:22} {:>9} {:>9} {:>9} {:>13} {:>8} {:>14} {:>14}",
        "condition", "first", "found", "certain", "false certain", "no start", "renders", "forward"
    );
    for c in columns {
        println!(
            "{:22} {:>9} {:>9} {:>9} {:>13} {:8} {:>14} {:>14}",
            c.name,
            of(c.found_first, c.trials),
            of(c.found, c.trials),
            format!("{}, {}", c.certain_first, c.certain),
            format!("{}, {}", c.false_certain_first, c.false_certain),
            c.no_start,
            spread(&c.full_renders),
            spread(&c.in_forward_renders),
        );
    }
}

fn dropouts(columns: &[&Column]) {
    println!(
        "\ndropouts: runs found again and certain at the first clear frame, and within {CLEAR};"
    );
    println!(
        "clear frames until then: median, most; certain, false certain: frames of the dropouts;"
    );
    println!("longest: a frame, in forward renders");
    println!(
        "{:38} {:>6} {:>6} {:>6} {:>12} {:>8} {:>13} {:>8}",
        "dropout",
        "before",
        "first",
        "found",
        "clear frames",
        "certain",
        "false certain",
        "longest"
    );
    for c in columns {
        let until = Spread::of(c.until_found.iter().copied());
        let number = |v: f64| if v.is_finite() { format!("{v}") } else { "never".to_owned() };
        println!(
            "{:38} {:>6} {:>6} {:>6} {:>12} {:8} {:13} {:8.1}",
            c.name,
            of(c.good, c.trials),
            of(c.found_first, c.trials),
            of(c.found, c.trials),
            format!("{}, {}", number(until.median), number(until.most)),
            c.certain_dropout,
            c.false_certain_dropout,
            c.in_forward_renders.most,
        );
    }
}

fn foreign(columns: &[&Column]) {
    println!(
        "\nforeign: frames of another scene; certain at the first frame, and within {TRIES}: should be 0"
    );
    println!(
        "{:14} {:>9} {:>9} {:>8} {:>14} {:>14}",
        "start", "first", "certain", "no start", "renders", "forward"
    );
    for c in columns {
        println!(
            "{:14} {:>9} {:>9} {:8} {:>14} {:>14}",
            c.name,
            of(c.certain_first, c.trials),
            of(c.certain, c.trials),
            c.no_start,
            spread(&c.full_renders),
            spread(&c.in_forward_renders),
        );
    }
}
