//! PSNR of what is shown, over time.

use std::path::Path;

use plotters::prelude::*;

use super::report::LinkRun;

const SIZE: (u32, u32) = (1000, 480);
/// Room above and below the curves, dB.
const MARGIN: f64 = 0.5;

/// A curve for each setting.
pub fn draw(path: &Path, runs: &[LinkRun]) -> anyhow::Result<()> {
    let root = SVGBackend::new(path, SIZE).into_drawing_area();
    root.fill(&WHITE)?;
    let all = || runs.iter().flat_map(|run| &run.moments).map(|moment| moment.psnr);
    let low = all().fold(f64::INFINITY, f64::min).max(0.0) - MARGIN;
    let high = all().fold(0.0, f64::max).min(60.0) + MARGIN;
    let seconds = runs.iter().map(|run| run.seconds).fold(0.0, f64::max);
    let mut chart = ChartBuilder::on(&root)
        .caption("PSNR of what the pilot sees, pictures that are held included", ("sans-serif", 20))
        .margin(16)
        .x_label_area_size(44)
        .y_label_area_size(56)
        .build_cartesian_2d(0.0..seconds, low..high)?;
    chart
        .configure_mesh()
        .x_desc("seconds (exposure)")
        .y_desc("dB")
        .label_style(("sans-serif", 15))
        .draw()?;
    for (k, run) in runs.iter().enumerate() {
        let colour = Palette99::pick(k).to_rgba();
        let (loss, fps) = (run.setting.loss, run.setting.fps);
        let points = run.moments.iter().map(|m| (m.frame as f64 / fps, m.psnr));
        let name = format!("{:.0} % lost, mean {:.2} dB", 100.0 * loss.chance, run.shown_psnr());
        chart
            .draw_series(LineSeries::new(points, colour.stroke_width(2)))?
            .label(name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 20, y)], colour.stroke_width(2)));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::LowerRight)
        .background_style(WHITE.mix(0.8))
        .border_style(BLACK)
        .label_font(("sans-serif", 15))
        .draw()?;
    Ok(root.present()?)
}
