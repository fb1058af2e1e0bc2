//! Ribbon plots, as in the paper: a solid line for the median, shade between the quartiles.

use std::path::Path;

use plotters::coord::Shift;
use plotters::coord::ranged1d::ValueFormatter;
use plotters::prelude::*;

use super::judge::Judged;
use super::method::Method;
use super::perturbation::{BINS, Kind};
use super::summary::Ablation;
use nvsprior_inputs::statistics::Quartiles;

const SIZE: (u32, u32) = (1440, 700);
/// Height of the caption and the legend.
const HEAD: u32 = 64;

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// A figure that is plotted.
struct Figure {
    name: &'static str,
    log: bool,
    /// Whether more is better.
    gain: bool,
    of: fn(&Judged) -> f64,
}

const FIGURES: [Figure; 4] = [
    Figure { name: "PSNR of the render, dB", log: false, gain: true, of: |o| o.verdict.psnr() },
    Figure {
        name: "energy of the difference (MSE)",
        log: true,
        gain: false,
        of: |o| o.verdict.energy,
    },
    Figure {
        name: "bytes of the difference",
        log: false,
        gain: false,
        of: |o| o.verdict.bytes as f64,
    },
    Figure {
        name: "iterations (evaluations)",
        log: true,
        gain: false,
        of: |o| o.attempt.iterations as f64,
    },
];

/// A method's curve: places on the x axis, and the quartiles there.
struct Curve {
    method: Method,
    points: Vec<(f64, Quartiles)>,
}

/// The mean squared error against the matching loss.
pub fn losses(path: &Path, ablation: &Ablation) -> anyhow::Result<()> {
    let methods = [(Method::BFGS, "MSE by BFGS"), (Method::Matching, "matching loss")];
    draw(path, "Losses by the size of the start's perturbation", ablation, &methods)
}

/// The optimisers of the mean squared error.
pub fn optimizers(path: &Path, ablation: &Ablation) -> anyhow::Result<()> {
    let methods = [
        (Method::BFGS, "BFGS"),
        (Method::ADAM, "Adam"),
        (Method::ADAM_BFGS, "Adam, then BFGS"),
        (Method::GAUSS_NEWTON, "Gauss–Newton"),
    ];
    draw(path, "Optimisers of the MSE by the size of the start's perturbation", ablation, &methods)
}

fn colour(method: Method) -> RGBColor {
    match method {
        Method::BFGS => RGBColor(31, 119, 180),
        Method::Matching => RGBColor(214, 39, 40),
        Method::ADAM => RGBColor(214, 120, 0),
        Method::ADAM_BFGS => RGBColor(44, 140, 44),
        _ => RGBColor(120, 60, 170),
    }
}

/// One row per kind of perturbation, one column per figure.
fn draw(
    path: &Path,
    caption: &str,
    ablation: &Ablation,
    methods: &[(Method, &str)],
) -> anyhow::Result<()> {
    let root = SVGBackend::new(path, SIZE).into_drawing_area();
    root.fill(&WHITE)?;
    let (head, body) = root.split_vertically(HEAD);
    head.draw(&Text::new(caption, (16, 8), ("sans-serif", 22)))?;
    let measured = |(method, _): &&(Method, &str)| {
        ablation.trials.iter().any(|trial| trial.outcome.method == *method)
    };
    let methods: Vec<_> = methods.iter().filter(measured).collect();
    let mut left = 20;
    for (method, name) in &methods {
        let colour = colour(*method);
        head.draw(&Rectangle::new([(left, 38), (left + 28, 56)], colour.mix(0.25).filled()))?;
        head.draw(&PathElement::new([(left, 47), (left + 28, 47)], colour.stroke_width(3)))?;
        head.draw(&Text::new((*name).to_owned(), (left + 36, 38), ("sans-serif", 17)))?;
        left += 64 + 9 * name.chars().count() as i32;
    }
    head.draw(&Text::new("line: median; shade: quartiles", (left + 20, 38), ("sans-serif", 17)))?;
    let cells = body.split_evenly((Kind::ALL.len(), FIGURES.len()));
    let panels = Kind::ALL.into_iter().flat_map(|kind| FIGURES.iter().map(move |f| (kind, f)));
    for ((kind, figure), cell) in panels.zip(&cells) {
        let curves: Vec<Curve> =
            methods.iter().map(|(method, _)| curve(ablation, *method, kind, figure)).collect();
        panel(cell, kind, ablation.limits.of(kind), figure, &curves)?;
    }
    Ok(root.present()?)
}

/// Quartiles of each bin that has trials, at the bin's middle.
fn curve(ablation: &Ablation, method: Method, kind: Kind, figure: &Figure) -> Curve {
    let point = |bin| {
        let results = ablation.bin(method, kind, bin);
        let [from, to] = ablation.limits.bounds(kind, bin);
        let values = results.into_iter().map(figure.of);
        let quartiles =
            if figure.gain { Quartiles::of_gains(values) } else { Quartiles::of(values) };
        (0.5 * (from + to), quartiles)
    };
    let finite = |(_, q): &(f64, Quartiles)| q.first.is_finite() && q.third.is_finite();
    Curve { method, points: (0..BINS).map(point).filter(finite).collect() }
}

fn panel(
    cell: &Area,
    kind: Kind,
    limit: f64,
    figure: &Figure,
    curves: &[Curve],
) -> anyhow::Result<()> {
    let quartiles = || curves.iter().flat_map(|curve| &curve.points);
    let low = quartiles().map(|(_, q)| q.first).fold(f64::INFINITY, f64::min);
    let high = quartiles().map(|(_, q)| q.third).fold(f64::NEG_INFINITY, f64::max);
    if !(low.is_finite() && high.is_finite()) {
        let text = format!("{}: nothing to show", figure.name);
        return Ok(cell.draw(&Text::new(text, (20, 40), ("sans-serif", 15)))?);
    }
    let mut chart = ChartBuilder::on(cell);
    chart.margin(10).margin_right(26).x_label_area_size(42).y_label_area_size(66);
    if figure.log && low > 0.0 {
        // Whole decades: only these have labels.
        let [low, high] = [low.log10().floor(), high.log10().ceil()].map(|e| 10f64.powf(e));
        let chart =
            chart.build_cartesian_2d(0.0..limit, (low..high.max(10.0 * low)).log_scale())?;
        fill(chart, kind, figure, curves, low < 0.05)
    } else {
        let margin = (0.06 * (high - low)).max(1e-3);
        let chart = chart.build_cartesian_2d(0.0..limit, low - margin..high + margin)?;
        fill(chart, kind, figure, curves, false)
    }
}

fn fill<'a, 'b, Y>(
    mut chart: ChartContext<
        'a,
        SVGBackend<'b>,
        Cartesian2d<plotters::coord::types::RangedCoordf64, Y>,
    >,
    kind: Kind,
    figure: &Figure,
    curves: &[Curve],
    small: bool,
) -> anyhow::Result<()>
where
    Y: Ranged<ValueType = f64> + ValueFormatter<f64>,
{
    let x_label = match kind {
        Kind::Rotation => "rotation put off by, degrees",
        Kind::Translation => "translation put off by, units",
    };
    let y_label = |v: &f64| if small { format!("{v:.0e}") } else { format!("{v}") };
    let mut mesh = chart.configure_mesh();
    mesh.x_labels(6)
        .y_labels(6)
        .x_desc(x_label)
        .y_desc(figure.name)
        .max_light_lines(if figure.log { 9 } else { 1 });
    mesh.label_style(("sans-serif", 14)).axis_desc_style(("sans-serif", 15));
    if small {
        mesh.y_label_formatter(&y_label);
    }
    mesh.draw()?;
    for Curve { method, points } in curves {
        let lower = points.iter().map(|(x, q)| (*x, q.first));
        let upper = points.iter().rev().map(|(x, q)| (*x, q.third));
        let outline: Vec<_> = lower.chain(upper).collect();
        let shade = colour(*method).mix(0.18).filled();
        chart.draw_series(std::iter::once(Polygon::new(outline, shade)))?;
    }
    for Curve { method, points } in curves {
        let colour = colour(*method);
        let medians = || points.iter().map(|(x, q)| (*x, q.median));
        chart.draw_series(LineSeries::new(medians(), colour.stroke_width(2)))?;
        chart.draw_series(medians().map(|at| Circle::new(at, 3, colour.filled())))?;
    }
    Ok(())
}
