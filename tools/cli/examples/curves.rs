//! PSNR against CPU time of trainings, in one plot.
//!
//!     cargo run --release -p nvsprior-cli --example curves -- OUT.svg NAME=curve.csv…
//!
//! `curve.csv` is that of the report of `nvsprior map`. A curve is drawn for each file and split.

use std::path::Path;

use anyhow::{Context, ensure};
use plotters::prelude::*;

const SIZE: (u32, u32) = (900, 520);
/// Told apart on white, also by those who see few colours (Okabe and Ito 2008).
const COLOURS: [RGBColor; 6] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(0, 0, 0),
];

/// Points of one split: CPU seconds and dB.
struct Curve {
    name: String,
    points: Vec<(f64, f64)>,
}

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [out, files @ ..] = arguments.as_slice() else {
        anyhow::bail!("OUT.svg NAME=curve.csv…")
    };
    let mut curves = Vec::new();
    for file in files {
        let (name, path) = file.split_once('=').with_context(|| format!("{file}: no NAME="))?;
        read(name, Path::new(path), &mut curves).with_context(|| path.to_owned())?;
    }
    ensure!(!curves.is_empty(), "no curve.csv to draw");
    draw(Path::new(out), &curves)
}

/// Adds the curves of a file.
fn read(name: &str, path: &Path, curves: &mut Vec<Curve>) -> anyhow::Result<()> {
    let text = std::fs::read_to_string(path)?;
    let mut lines = text.lines();
    let head: Vec<&str> = lines.next().unwrap_or("").split(',').collect();
    let column = |wanted: &str| {
        head.iter().position(|own| *own == wanted).with_context(|| format!("no column {wanted}"))
    };
    let (seconds, split, psnr) = (column("cpu_seconds")?, column("split")?, column("psnr_db")?);
    for line in lines {
        let values: Vec<&str> = line.split(',').collect();
        let at = |k: usize| values.get(k).with_context(|| format!("a row is short: {line}"));
        let point = (at(seconds)?.parse()?, at(psnr)?.parse()?);
        let name = format!("{}, {name}", at(split)?);
        match curves.iter_mut().find(|curve| curve.name == name) {
            Some(curve) => curve.points.push(point),
            None => curves.push(Curve { name, points: vec![point] }),
        }
    }
    Ok(())
}

fn draw(out: &Path, curves: &[Curve]) -> anyhow::Result<()> {
    let all = || curves.iter().flat_map(|curve| &curve.points);
    let most = |of: fn(&(f64, f64)) -> f64| all().map(of).fold(f64::NEG_INFINITY, f64::max);
    let (right, high) = (most(|point| point.0), most(|point| point.1));
    let low = all().map(|point| point.1).fold(f64::INFINITY, f64::min);
    let root = SVGBackend::new(out, SIZE).into_drawing_area();
    root.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&root)
        .margin(16)
        .x_label_area_size(48)
        .y_label_area_size(64)
        .caption("PSNR of held-out pictures against CPU time", ("sans-serif", 22))
        .build_cartesian_2d(0.0..right * 1.02, low - 0.1..high + 0.2)?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .label_style(("sans-serif", 16))
        .x_desc("CPU seconds")
        .y_desc("dB")
        .draw()?;
    for (i, Curve { name, points }) in curves.iter().enumerate() {
        let colour = COLOURS[i % COLOURS.len()];
        let line = LineSeries::new(points.iter().copied(), colour.stroke_width(2)).point_size(3);
        chart
            .draw_series(line)?
            .label(name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 24, y)], colour.stroke_width(2)));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::LowerRight)
        .label_font(("sans-serif", 16))
        .background_style(WHITE.mix(0.8))
        .border_style(BLACK.mix(0.3))
        .draw()?;
    root.present()?;
    Ok(())
}
