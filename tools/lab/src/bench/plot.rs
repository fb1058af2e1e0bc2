//! The plots.

use std::path::Path;

use nvsprior::image::psnr_of_mse;
use nvsprior_inputs::plot::{Series, Words, bounds, draw};
use plotters::prelude::SeriesLabelPosition;

use super::configurations::Row as Configuration;
use super::context::{Context, OptimizerRun, Sample};
use super::stages::Stages;
use nvsprior_inputs::statistics::median;

/// A name, and the points that a line joins.
pub type Curve = (String, Vec<(f64, f64)>);

fn joined((name, points): Curve) -> Series {
    Series { name, points, line: true, dots: true }
}

const POINTS: usize = 400;

/// Losses below this are drawn here, dB: they are as good as none.
const MIN_LOSS: f64 = 1e-4;

/// The best full-resolution PSNR that each optimiser had reached by a time, as a median over
/// frames. (A mean would have to wait for the first frame, whose start is far off.) A curve begins
/// at the time at which half of the frames have had a full-resolution render.
pub fn trace(path: &Path, runs: &[OptimizerRun]) -> anyhow::Result<()> {
    let series = runs.iter().map(|run| {
        let name = run.optimizer.name().into();
        Series { name, points: curve(run), line: true, dots: false }
    });
    let words = Words {
        caption: "PSNR of the render against run time, median over frames",
        x: "milliseconds",
        y: "dB",
        legend: SeriesLabelPosition::LowerRight,
    };
    draw(path, &words, false, &series.collect::<Vec<_>>(), &[])
}

/// How far each trial stayed below the best known pose, against its run time.
pub fn trials(path: &Path, context: &Context, kinds: &[(&str, &[Sample])]) -> anyhow::Result<()> {
    let series = kinds.iter().map(|(name, samples)| {
        let point = |s: &Sample| (s.in_forward_renders(), context.short(s).max(MIN_LOSS));
        let points = samples.iter().map(point).collect();
        Series { name: (*name).into(), points, line: false, dots: true }
    });
    let words = Words {
        caption: "Below the best known pose's render, by trial",
        x: "forward renders",
        y: "dB",
        legend: SeriesLabelPosition::UpperRight,
    };
    draw(path, &words, true, &series.collect::<Vec<_>>(), &[])
}

/// Loss against run time of settings, the Pareto set joined.
pub fn configurations(path: &Path, rows: &[Configuration]) -> anyhow::Result<()> {
    let point =
        |row: &Configuration| (row.in_forward_renders.median, row.loss.median.max(MIN_LOSS));
    let labels: Vec<_> = rows.iter().map(|row| (point(row), row.name.clone())).collect();
    let mut best: Vec<_> = rows.iter().filter(|row| row.pareto).map(point).collect();
    best.sort_by(|a, b| a.0.total_cmp(&b.0));
    let others = rows.iter().filter(|row| !row.pareto).map(point).collect();
    let series = [
        Series { name: "Pareto set".into(), points: best, line: true, dots: true },
        Series { name: "others".into(), points: others, line: false, dots: true },
    ];
    let words = Words {
        caption: "Loss against run time of settings, medians",
        x: "forward renders",
        y: "dB below the best known pose's render",
        legend: SeriesLabelPosition::UpperRight,
    };
    draw(path, &words, true, &series, &labels)
}

/// Stages under the ceilings of copying and arithmetic.
pub fn roofline(path: &Path, stages: &Stages) -> anyhow::Result<()> {
    let mut series: Vec<Series> = Vec::new();
    let mut labels = Vec::new();
    let (mut low, mut high) = (0.1, 10.0);
    for stage in &stages.stages {
        let (work, seconds) = (stage.work, stage.ms * 1e-3);
        if !(work.flops > 0.0 && work.bytes > 0.0 && seconds > 0.0) {
            continue;
        }
        let point = (work.flops / work.bytes, work.flops / seconds * 1e-9);
        (low, high) = (point.0.min(low), point.0.max(high));
        match series.iter_mut().find(|s| s.name == stage.job) {
            Some(series) => series.points.push(point),
            None => series.push(Series {
                name: stage.job.into(),
                points: vec![point],
                line: false,
                dots: true,
            }),
        }
        labels.push((point, stage.name.into()));
    }
    let ratio = high / low;
    let roof = (0..=POINTS).map(|i| {
        let x = low * f64::powf(ratio, i as f64 / POINTS as f64);
        (x, (x * stages.ceilings.bytes).min(stages.ceilings.flops) * 1e-9)
    });
    let points = roof.collect();
    series.push(Series { name: "ceilings".into(), points, line: true, dots: false });
    let words = Words {
        caption: "Stages under the device's measured ceilings",
        x: "operations per byte, as counted",
        y: "GFLOP/s",
        legend: SeriesLabelPosition::LowerRight,
    };
    draw(path, &words, true, &series, &labels)
}

/// Forward renders by number of splats, one curve per size.
pub fn scaling(path: &Path, curves: Vec<Curve>) -> anyhow::Result<()> {
    let words = Words {
        caption: "Time against size",
        x: "splats",
        y: "milliseconds",
        legend: SeriesLabelPosition::UpperLeft,
    };
    draw(path, &words, true, &curves.into_iter().map(joined).collect::<Vec<_>>(), &[])
}

/// Time and memory by the splats of a site, as shares of those of the first one.
pub fn site(path: &Path, rows: &[serde_json::Value]) -> anyhow::Result<()> {
    let of = |row: &serde_json::Value, name: &str| row[name].as_f64().unwrap_or(f64::NAN);
    let curves = [
        ("time of a frame, ms", "frame_ms", 1.0),
        ("host memory, MiB", "host_bytes", 1.0 / f64::from(1 << 20)),
        ("device memory, MiB", "device_bytes", 1.0 / f64::from(1 << 20)),
    ];
    let series = curves.map(|(name, field, unit)| {
        let points = rows.iter().map(|row| (of(row, "splats"), unit * of(row, field)));
        joined((name.into(), points.collect()))
    });
    let words = Words {
        caption: "A frame by the size of the site",
        x: "splats of the site",
        y: "milliseconds, MiB",
        legend: SeriesLabelPosition::LowerRight,
    };
    draw(path, &words, true, &series, &[])
}

/// How errors of poses are distributed, as multiples of what is stated: a curve for each axis.
pub fn pose_ratios(path: &Path, curves: Vec<Curve>) -> anyhow::Result<()> {
    let curve = |curve| Series { dots: false, ..joined(curve) };
    let words = Words {
        caption: "Share of the certain frames whose error is at most so many stated deviations",
        x: "stated standard deviations",
        y: "share of the frames",
        legend: SeriesLabelPosition::LowerRight,
    };
    draw(path, &words, false, &curves.into_iter().map(curve).collect::<Vec<_>>(), &[])
}

/// Something by the width of pictures, a curve for each name.
pub fn sizes(
    path: &Path,
    caption: &'static str,
    y: &'static str,
    curves: impl Iterator<Item = Curve>,
) -> anyhow::Result<()> {
    let series: Vec<Series> = curves.map(joined).collect();
    let points = || series.iter().flat_map(|series| series.points.iter());
    let mut labels: Vec<_> = points().map(|point| (*point, format!("{:.0}", point.1))).collect();
    // A logarithmic axis names powers of ten alone.
    let (low, _) = bounds(points().map(|point| point.1));
    let widths = series.first().into_iter().flat_map(|series| &series.points);
    labels.extend(widths.map(|(width, _)| ((*width, 0.82 * low), format!("{width} wide"))));
    let legend = SeriesLabelPosition::UpperLeft;
    let words = Words { caption, x: "width of the pictures, pixels", y, legend };
    draw(path, &words, true, &series, &labels)
}

/// PSNR of renders against the time of the search, a point for each size.
pub fn psnr_by_time(path: &Path, points: Vec<((f64, f64), String)>) -> anyhow::Result<()> {
    let own = points.iter().map(|(point, _)| *point).collect();
    let series = joined(("render at the pose found".into(), own));
    let words = Words {
        caption: "PSNR of the render against the time of the search",
        x: "milliseconds",
        y: "dB",
        legend: SeriesLabelPosition::LowerLeft,
    };
    draw(path, &words, false, &[series], &points)
}

/// PSNR against bytes, a curve per coder.
pub fn codecs(path: &Path, curves: Vec<Curve>) -> anyhow::Result<()> {
    let series = curves.into_iter().map(|(name, mut points)| {
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        joined((name, points))
    });
    let words = Words {
        caption: "PSNR against bytes, means per frame",
        x: "bytes per frame",
        y: "dB",
        legend: SeriesLabelPosition::LowerRight,
    };
    draw(path, &words, false, &series.collect::<Vec<_>>(), &[])
}

fn curve(run: &OptimizerRun) -> Vec<(f64, f64)> {
    // Per frame: times and best PSNR so far of full-resolution evaluations.
    let frames: Vec<Vec<(f64, f64)>> = run
        .samples
        .iter()
        .map(|sample| {
            let mut best = f64::INFINITY;
            let full = sample.trace.iter().filter(|e| e.level == 0);
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
    let points = (0..POINTS).map(|i| at((begin * ratio.powi(i as i32)).max(begin)));
    points.filter(|p| p.1.is_finite()).collect()
}
