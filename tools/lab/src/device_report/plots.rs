//! The plots of the report's page: bars beside each other, on a logarithmic scale.

use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::schema::{Coding, Report, Size};

/// Bars of one colour, one for each row; `None`: not known.
struct Series {
    name: String,
    values: Vec<Option<f64>>,
}

/// A plot: rows by name, from the top.
struct Bars {
    caption: String,
    rows: Vec<String>,
    series: Vec<Series>,
}

const WIDTH: u32 = 900;
/// Pixels of a bar, and of the room between rows.
const BAR: u32 = 13;
const BETWEEN: u32 = 9;
/// Pixels of a letter, about.
const LETTER: u32 = 8;
/// Rows' room above the bars, for the legend.
const LEGEND: f64 = 1.6;
const FONT: (&str, u32) = ("sans-serif", 13);

/// Stages of a job at a size: measured, at the ceilings, predicted. Those that take next to nothing are left out.
pub fn stages(size: &Size, job: &str) -> anyhow::Result<String> {
    let rows: Vec<_> =
        size.stages.iter().filter(|row| row.job == job && row.ceiling_ms.is_some()).collect();
    let series = |name: &str, values: Vec<Option<f64>>| Series { name: name.into(), values };
    draw(&Bars {
        caption: format!("{job}, {}×{}: milliseconds by stage", size.width, size.height),
        rows: rows.iter().map(|row| row.name.clone()).collect(),
        series: vec![
            series("measured", rows.iter().map(|row| row.ms).collect()),
            series("at the device's ceilings", rows.iter().map(|row| row.ceiling_ms).collect()),
            series("predicted", rows.iter().map(|row| row.predicted_ms).collect()),
        ],
    })
}

/// A frame's times, by size.
pub fn times(report: &Report) -> anyhow::Result<String> {
    let mut rows = vec![
        "forward render".to_owned(),
        "search, frame after frame".into(),
        "search, starts moved off".into(),
    ];
    let budgets = report.sizes.iter().flat_map(|size| &size.coding).map(|c| c.budget_bytes);
    let mut budgets: Vec<usize> = budgets.collect();
    budgets.sort_unstable();
    budgets.dedup();
    for budget in &budgets {
        rows.push(format!("encoded in full, {budget} bytes"));
        rows.push(format!("residual encoded, {budget} bytes"));
        rows.push(format!("decoded in full, {budget} bytes"));
        rows.push(format!("residual decoded, {budget} bytes"));
    }
    let of = |size: &Size| {
        let frame = |figures: &Option<_>| {
            figures.as_ref().map(|f: &crate::bench::report::Figures| f.frame_ms)
        };
        let mut values =
            vec![size.forward_render_ms, frame(&size.steady), frame(&size.perturbed_3deg)];
        for budget in &budgets {
            let coding = size.coding.iter().find(|c| c.budget_bytes == *budget);
            values.extend(coding.map_or([None; 4], medians));
        }
        Series { name: format!("{}×{}", size.width, size.height), values }
    };
    let series = report.sizes.iter().map(of).collect();
    draw(&Bars { caption: "A frame: milliseconds, medians".into(), rows, series })
}

/// As in the rows of [`times`].
fn medians(c: &Coding) -> [Option<f64>; 4] {
    let [decode, residual, residual_decode] =
        [&c.decode_ms, &c.residual_encode_ms, &c.residual_decode_ms].map(|spread| spread.median);
    let encode = c.encode_ms.map(|spread| spread.median);
    [encode, Some(residual), Some(decode), Some(residual_decode)]
}

/// A plot of rows by milliseconds, with a logarithmic scale.
type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<LogCoord<f64>, RangedCoordf64>>;

/// Draws as SVG.
fn draw(bars: &Bars) -> anyhow::Result<String> {
    let Bars { caption, rows, series } = bars;
    let known = || series.iter().flat_map(|s| &s.values).flatten().filter(|v| **v > 0.0);
    let low = known().fold(f64::INFINITY, |low, v| low.min(*v)) * 0.5;
    let high = known().fold(0.0, |high, v| v.max(high)) * 2.0;
    if !(low < high) {
        return Ok(format!("<p>{caption}: nothing to show</p>\n"));
    }
    let height = (bars.row() * (rows.len() as f64 + LEGEND)) as u32 + 90;
    let longest = rows.iter().map(|name| name.chars().count()).max().unwrap_or(0) as u32;
    let mut svg = String::new();
    let root = SVGBackend::with_string(&mut svg, (WIDTH, height)).into_drawing_area();
    root.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&root)
        .margin(12)
        .caption(caption, ("sans-serif", 18))
        .x_label_area_size(40)
        .y_label_area_size(longest * LETTER + 16)
        .build_cartesian_2d((low..high).log_scale(), -0.5..bars.last() + 0.5 + LEGEND)?;
    let mut mesh = chart.configure_mesh();
    mesh.disable_y_mesh().disable_y_axis().x_labels(10).x_desc("milliseconds").label_style(FONT);
    mesh.draw()?;
    let style = FONT.into_font().into_text_style(&root).pos(Pos::new(HPos::Right, VPos::Center));
    for (i, name) in rows.iter().enumerate() {
        let (x, y) = chart.plotting_area().map_coordinate(&(low, bars.last() - i as f64));
        root.draw(&Text::new(name.as_str(), (x - 8, y), style.clone()))?;
    }
    for place in 0..series.len() {
        bars.fill(&mut chart, place, low)?;
    }
    let mut legend = chart.configure_series_labels();
    legend.position(SeriesLabelPosition::UpperRight).background_style(WHITE);
    legend.border_style(BLACK).label_font(FONT).draw()?;
    root.present()?;
    drop(chart);
    drop(root);
    Ok(svg)
}

impl Bars {
    /// Pixels of a row.
    fn row(&self) -> f64 {
        f64::from(BAR * self.series.len() as u32 + BETWEEN)
    }

    /// Place of the first row; that of the last one is 0.
    fn last(&self) -> f64 {
        self.rows.len() as f64 - 1.0
    }

    /// Draws a series, with its values beside the bars.
    fn fill<'a>(&'a self, chart: &mut Chart<'a, '_>, place: usize, low: f64) -> anyhow::Result<()> {
        let Series { name, values } = &self.series[place];
        let colour = Palette99::pick(place).to_rgba();
        let thick = f64::from(BAR) / self.row();
        let bar = |(i, value): (usize, &Option<f64>)| {
            let above = thick * (0.5 * self.series.len() as f64 - place as f64);
            let top = self.last() - i as f64 + above;
            value.filter(|v| *v > 0.0).map(|v| (v, top))
        };
        let drawn: Vec<_> = values.iter().enumerate().filter_map(bar).collect();
        let boxes = drawn
            .iter()
            .map(|(v, top)| Rectangle::new([(low, top - thick), (*v, *top)], colour.filled()));
        let sample = move |(x, y)| Rectangle::new([(x, y - 5), (x + 16, y + 5)], colour.filled());
        chart.draw_series(boxes)?.label(name.as_str()).legend(sample);
        let texts = drawn.iter().map(|(v, top)| {
            EmptyElement::at((*v, *top)) + Text::new(number(*v), (4, 1), ("sans-serif", 11))
        });
        chart.draw_series(texts)?;
        Ok(())
    }
}

/// A number in three digits or more.
fn number(value: f64) -> String {
    let digits = (2.0 - value.log10().floor()).clamp(0.0, 6.0) as usize;
    format!("{value:.digits$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_and_value_is_named() {
        let series = |name: &str, values| Series { name: name.into(), values };
        let svg = draw(&Bars {
            caption: "Times".into(),
            rows: vec!["project".into(), "splat".into()],
            series: vec![
                series("measured", vec![Some(1.25), None]),
                series("predicted", vec![Some(0.5), Some(40.0)]),
            ],
        })
        .unwrap();
        for text in ["Times", "project", "splat", "measured", "predicted", "1.25", "0.500", "40.0"]
        {
            assert!(svg.contains(text), "{text}: {svg}");
        }
        assert!(svg.trim_end().ends_with("</svg>"));
    }

    #[test]
    fn nothing_known_is_said() {
        let series = vec![Series { name: "measured".into(), values: vec![None] }];
        let bars = Bars { caption: "Times".into(), rows: vec!["splat".into()], series };
        assert!(draw(&bars).unwrap().contains("nothing to show"));
    }
}
