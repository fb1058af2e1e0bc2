//! One bar per column: the share of trials that were found, and the share that were false certain.

use std::path::Path;

use plotters::coord::Shift;
use plotters::prelude::*;

use super::Measurement;
use super::summary::Column;

const WIDTH: i32 = 1000;
/// Height of the caption and the legend.
const HEAD: i32 = 84;
/// Height of a bar with the space around it.
const ROW: i32 = 26;
/// Where bars begin and end.
const BARS: [i32; 2] = [340, 800];

const FIRST: RGBColor = RGBColor(31, 119, 180);
const LATER: RGBColor = RGBColor(158, 202, 235);
const WRONG: RGBColor = RGBColor(214, 39, 40);

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

pub fn draw(path: &Path, columns: &[Column]) -> anyhow::Result<()> {
    let groups: Vec<&[Column]> = columns.chunk_by(|a, b| a.measurement == b.measurement).collect();
    let rows = columns.len() + 2 * groups.len();
    let height = HEAD + ROW * (rows as i32 + 1);
    let root = SVGBackend::new(path, (WIDTH as u32, height as u32)).into_drawing_area();
    root.fill(&WHITE)?;
    text(&root, "Poses found again, share of trials", [16, 10], 22)?;
    legend(&root)?;
    let mut top = HEAD;
    for group in groups {
        text(&root, heading(group[0].measurement), [16, top + 4], 17)?;
        scale(&root, top, ROW * (group.len() as i32 + 1))?;
        top += ROW;
        for column in group {
            bar(&root, top, column)?;
            top += ROW;
        }
        top += ROW;
    }
    Ok(root.present()?)
}

fn heading(measurement: Measurement) -> &'static str {
    match measurement {
        Measurement::Capture => "Starts put off by",
        Measurement::Nothing => "From nothing",
        Measurement::Dropouts => "After a dropout",
        Measurement::Foreign => "In another scene",
    }
}

fn text(root: &Area, text: &str, [x, y]: [i32; 2], size: i32) -> anyhow::Result<()> {
    Ok(root.draw(&Text::new(text.to_owned(), (x, y), ("sans-serif", size)))?)
}

fn block(
    root: &Area,
    [left, top]: [i32; 2],
    width: f64,
    height: i32,
    colour: RGBColor,
) -> anyhow::Result<()> {
    let corner = (left + width.round() as i32, top + height);
    Ok(root.draw(&Rectangle::new([(left, top), corner], colour.filled()))?)
}

fn legend(root: &Area) -> anyhow::Result<()> {
    let entries = [
        (FIRST, "found at the first frame", 16),
        (LATER, "found at a later one", 256),
        (WRONG, "certain of a wrong pose, at any frame", 466),
    ];
    for (colour, name, left) in entries {
        block(root, [left, 50], 24.0, 14, colour)?;
        text(root, name, [left + 32, 48], 16)?;
    }
    Ok(())
}

/// Quarters, with their numbers above.
fn scale(root: &Area, top: i32, height: i32) -> anyhow::Result<()> {
    for quarter in 0..=4 {
        let x = BARS[0] + (BARS[1] - BARS[0]) * quarter / 4;
        root.draw(&PathElement::new([(x, top + 22), (x, top + height)], RGBColor(210, 210, 210)))?;
        text(root, &format!("{} %", 25 * quarter), [x - 14, top + 4], 14)?;
    }
    Ok(())
}

fn bar(root: &Area, top: i32, column: &Column) -> anyhow::Result<()> {
    let length =
        |count: usize| f64::from(BARS[1] - BARS[0]) * count as f64 / column.trials.max(1) as f64;
    text(root, &column.name, [32, top + 4], 15)?;
    block(root, [BARS[0], top + 3], length(column.found), 13, LATER)?;
    block(root, [BARS[0], top + 3], length(column.found_first), 13, FIRST)?;
    block(root, [BARS[0], top + 16], length(column.false_certain), 6, WRONG)?;
    let Column { found_first, found, false_certain, trials, .. } = column;
    let counts = match column.measurement {
        Measurement::Foreign => format!("certain {false_certain} of {trials}"),
        Measurement::Capture => format!("{found} of {trials}"),
        _ => format!("{found_first}, {found} of {trials}"),
    };
    text(root, &counts, [BARS[1] + 20, top + 4], 15)
}
