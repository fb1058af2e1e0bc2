//! The plot of error against run time.

use std::path::Path;

use nvsprior::picture::psnr_of_mse;
use plotters::prelude::*;

use super::OptimizerRun;

const SIZE: (u32, u32) = (900, 560);
/// Points of a curve.
const POINTS: usize = 400;

/// Writes the plot: the best full-resolution PSNR that each optimiser had reached by a time, median
/// over frames (a mean would have to wait for the first frame, whose start is far off). A curve
/// begins where half of the frames have had a full-resolution render.
pub fn write(path: &Path, runs: &[OptimizerRun]) -> anyhow::Result<()> {
    let curves: Vec<Vec<(f64, f64)>> = runs.iter().map(curve).collect();
    let points = || curves.iter().flatten();
    let (first, last) = bounds(points().map(|p| p.0));
    let (low, high) = bounds(points().map(|p| p.1));
    if !(first < last) {
        eprintln!("no plot: no optimiser rendered at full resolution more than once");
        return Ok(());
    }
    let root = SVGBackend::new(path, SIZE).into_drawing_area();
    root.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&root)
        .margin(16)
        .x_label_area_size(44)
        .y_label_area_size(56)
        .caption("PSNR of the render against run time, median over frames", ("sans-serif", 20))
        .build_cartesian_2d((first..last).log_scale(), low - 0.2..high + 0.2)?;
    chart.configure_mesh().x_labels(12).x_desc("milliseconds").y_desc("dB").draw()?;
    for (index, (run, curve)) in runs.iter().zip(curves).enumerate() {
        let colour = Palette99::pick(index).to_rgba();
        chart
            .draw_series(LineSeries::new(curve, colour.stroke_width(2)))?
            .label(run.optimizer.name())
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 20, y)], colour.stroke_width(2)));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::LowerRight)
        .background_style(WHITE)
        .border_style(BLACK)
        .draw()?;
    Ok(root.present()?)
}

/// Least and greatest of values.
fn bounds(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
}

fn curve(run: &OptimizerRun) -> Vec<(f64, f64)> {
    // Per frame: times and best PSNR so far of full-resolution evaluations.
    let frames: Vec<Vec<(f64, f64)>> = run
        .frames
        .iter()
        .map(|frame| {
            let mut best = f64::INFINITY;
            let full = frame.trace.iter().filter(|e| e.level == 0);
            full.map(|e| {
                best = best.min(e.mse);
                (e.milliseconds, psnr_of_mse(best))
            })
            .collect()
        })
        .collect();
    let begin = median(frames.iter().map(|f| f.first().map_or(f64::INFINITY, |p| p.0)));
    let end = frames.iter().filter_map(|f| f.last()).map(|p| p.0).fold(0.0, f64::max);
    if !(begin > 0.0 && end > begin) {
        return Vec::new();
    }
    let at = |t: f64| {
        let reached = |f: &Vec<(f64, f64)>| f.iter().rev().find(|p| p.0 <= t).map(|p| p.1);
        (t, median(frames.iter().map(|f| reached(f).unwrap_or(f64::NEG_INFINITY))))
    };
    let ratio = (end / begin).powf(1.0 / (POINTS - 1) as f64);
    (0..POINTS).map(|i| at((begin * ratio.powi(i as i32)).max(begin))).collect()
}

/// The upper median: no value between two is made up.
fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}
