//! The columns as text.

use super::super::context::Context;
use super::Measurement;
use super::dropouts::CLEAR;
use super::probe::TRIES;
use super::summary::{Column, DropoutFigures, EARLY, Early};
use nvsprior_inputs::report::{self, Table, fixed};
use nvsprior_inputs::statistics::{Spread, median};

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
    let early = |early: Early| of(early.found_early, early.early);
    table(
        columns,
        &[
            ("put off by", &|c| c.name.clone()),
            (&format!("first {EARLY}"), &|c| c.early.map_or(String::new(), early)),
            ("found", &|c| of(c.found_first, c.trials)),
            ("uncertain", &|c| c.uncertain_first().to_string()),
            ("false certain", &|c| c.false_certain.to_string()),
            ("renders", &|c| spread(&c.full_renders)),
            ("forward", &|c| spread(&c.in_forward_renders)),
        ],
    );
}

fn nothing(columns: &[&Column]) {
    println!("\nnothing: no pose; trials found at the first frame, and within {TRIES} of the same");
    println!("certain, false certain: at the first frame, at any; no start: frames");
    table(
        columns,
        &[
            ("condition", &|c| c.name.clone()),
            ("first", &|c| of(c.found_first, c.trials)),
            ("found", &|c| of(c.found, c.trials)),
            ("certain", &|c| format!("{}, {}", c.certain_first, c.certain)),
            ("false certain", &|c| format!("{}, {}", c.false_certain_first, c.false_certain)),
            ("no start", &|c| c.no_start.to_string()),
            ("renders", &|c| spread(&c.full_renders)),
            ("forward", &|c| spread(&c.in_forward_renders)),
        ],
    );
}

fn dropouts(columns: &[&Column]) {
    println!(
        "\ndropouts: runs found again and certain at the first clear frame, and within {CLEAR};"
    );
    println!(
        "clear frames until then: median, most; certain, false certain: frames of the dropouts;"
    );
    println!("longest: a frame, in forward renders");
    let number = |v: f64| if v.is_finite() { format!("{v}") } else { "never".to_owned() };
    let until = |c: &Column| {
        let until = Spread::of(c.until_found.iter().copied());
        format!("{}, {}", number(until.median), number(until.max))
    };
    table(
        columns,
        &[
            ("dropout", &|c| c.name.clone()),
            ("before", &|c| dropout(c, |d| of(d.found_before, c.trials))),
            ("first", &|c| of(c.found_first, c.trials)),
            ("found", &|c| of(c.found, c.trials)),
            ("clear frames", &|c| until(c)),
            ("certain", &|c| dropout(c, |d| d.certain_dropout_frames.to_string())),
            ("false certain", &|c| dropout(c, |d| d.false_certain_dropout_frames.to_string())),
            ("longest", &|c| fixed(c.in_forward_renders.max, 1)),
        ],
    );
}

/// A cell of what only dropouts have.
fn dropout(column: &Column, cell: impl FnOnce(DropoutFigures) -> String) -> String {
    column.dropout.map_or(String::new(), cell)
}

fn foreign(columns: &[&Column]) {
    println!(
        "\nforeign: frames of another scene; certain at the first frame, and within {TRIES}: should be 0"
    );
    table(
        columns,
        &[
            ("start", &|c| c.name.clone()),
            ("first", &|c| of(c.certain_first, c.trials)),
            ("certain", &|c| of(c.certain, c.trials)),
            ("no start", &|c| c.no_start.to_string()),
            ("renders", &|c| spread(&c.full_renders)),
            ("forward", &|c| spread(&c.in_forward_renders)),
        ],
    );
}

fn table(rows: &[&Column], columns: &[report::Column<Column>]) {
    Table::of(rows.iter().copied(), columns).print();
}
