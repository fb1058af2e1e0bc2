//! Points and lines over a logarithmic axis, as SVG.

use std::path::Path;

use plotters::prelude::*;

const SIZE: (u32, u32) = (900, 560);

/// A plot's texts, and the place of its legend.
pub struct Words {
    pub caption: &'static str,
    pub x: &'static str,
    pub y: &'static str,
    pub legend: SeriesLabelPosition,
}

/// Points of one kind, and how they are drawn.
pub struct Series {
    pub name: String,
    pub points: Vec<(f64, f64)>,
    pub line: bool,
    pub dots: bool,
}

/// Draws with a logarithmic x axis; with `log_y` the y axis is logarithmic too.
pub fn draw(
    path: &Path,
    words: &Words,
    log_y: bool,
    series: &[Series],
    labels: &[((f64, f64), String)],
) -> anyhow::Result<()> {
    let points = || series.iter().flat_map(|s| &s.points);
    let (left, right) = bounds(points().map(|p| p.0));
    let (low, high) = bounds(points().map(|p| p.1));
    let root = SVGBackend::new(path, SIZE).into_drawing_area();
    root.fill(&WHITE)?;
    if !(left > 0.0 && right.is_finite() && low.is_finite() && high.is_finite()) {
        let style = ("sans-serif", 20).into_font();
        root.draw(&Text::new(format!("{}: nothing to show", words.caption), (40, 40), style))?;
        return Ok(root.present()?);
    }
    let across = (left * 0.9..right * 1.25).log_scale();
    let margin = (0.05 * (high - low)).max(1e-3);
    let mut chart = ChartBuilder::on(&root);
    chart
        .margin(16)
        .x_label_area_size(44)
        .y_label_area_size(64)
        .caption(words.caption, ("sans-serif", 20));
    if log_y && low > 0.0 {
        let chart = chart.build_cartesian_2d(across, (low * 0.8..high * 1.25).log_scale())?;
        fill(chart, words, series, labels)?;
    } else {
        let chart = chart.build_cartesian_2d(across, low - margin..high + margin)?;
        fill(chart, words, series, labels)?;
    }
    Ok(root.present()?)
}

fn fill<'a, X, Y>(
    mut chart: ChartContext<'a, SVGBackend<'a>, Cartesian2d<X, Y>>,
    words: &Words,
    series: &[Series],
    labels: &[((f64, f64), String)],
) -> anyhow::Result<()>
where
    X: Ranged<ValueType = f64> + plotters::coord::ranged1d::ValueFormatter<f64>,
    Y: Ranged<ValueType = f64> + plotters::coord::ranged1d::ValueFormatter<f64>,
{
    chart.configure_mesh().x_labels(12).x_desc(words.x).y_desc(words.y).draw()?;
    for (index, Series { name, points, line, dots }) in series.iter().enumerate() {
        let colour = Palette99::pick(index).to_rgba();
        if *line {
            let stroke = colour.stroke_width(2);
            chart.draw_series(LineSeries::new(points.iter().copied(), stroke))?;
        }
        let dot = |p: &(f64, f64)| Circle::new(*p, 3, colour.filled());
        let size = if *dots { points.len() } else { 0 };
        chart
            .draw_series(points.iter().take(size).map(dot))?
            .label(name.as_str())
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 20, y)], colour.stroke_width(2)));
    }
    let label = |(at, text): &((f64, f64), String)| {
        EmptyElement::at(*at) + Text::new(text.clone(), (5, -5), ("sans-serif", 11))
    };
    chart.draw_series(labels.iter().map(label))?;
    chart
        .configure_series_labels()
        .position(words.legend.clone())
        .background_style(WHITE.mix(0.8))
        .border_style(BLACK)
        .draw()?;
    Ok(())
}

/// Least and greatest of values.
pub fn bounds(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
}
