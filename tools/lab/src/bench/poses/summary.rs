//! A run in figures, as `nvsprior-lab poses` writes and prints them.

use nvsprior_inputs::report::{Table, fixed};
use serde::Serialize;

/// An axis over the certain frames.
#[derive(Serialize)]
pub struct Axis {
    pub name: &'static str,
    /// Medians: the prior's unit, or radians.
    pub error: f64,
    pub deviation: f64,
    /// Shares of the frames whose error is at most so many deviations. An open axis is within any.
    pub within_2: f64,
    pub within_4: f64,
    /// Share of the frames in which the axis is open.
    pub open: f64,
}

/// A run in figures.
#[derive(Serialize)]
pub struct Summary {
    pub condition: &'static str,
    pub frames: usize,
    pub certain: usize,
    /// Frames whose packet says that the position is known.
    pub known: usize,
    /// Those of them that are off by more than four times what is stated, along or about an axis.
    pub known_and_wrong: usize,
    pub axes: Vec<Axis>,
    /// Medians over the certain frames: the prior's unit, degrees.
    pub position_error: f64,
    pub rotation_error_degrees: f64,
    /// Means over all frames.
    pub render_psnr: f64,
    /// At 29, 31 and 33 dB.
    pub bytes: [f64; 3],
    /// Share of the frames of which a start ends more than [`super::BELOW`] dB below the best; null if not compared.
    pub starts_apart: Option<f64>,
}

pub fn print(runs: &[Summary]) {
    for run in runs {
        let Summary { condition, frames, certain, known, known_and_wrong, .. } = run;
        println!(
            "{condition}: {certain} of {frames} frames certain; position known in {known}, of which {known_and_wrong} \
             are off by more than four times what is stated"
        );
        let [low, middle, high] = run.bytes.map(|bytes| fixed(bytes, 0));
        println!(
            "off by {:.4} and {:.3}° (medians); render {:.2} dB; {low}, {middle}, {high} bytes at 29, 31, 33 dB",
            run.position_error, run.rotation_error_degrees, run.render_psnr
        );
        if let Some(apart) = run.starts_apart {
            println!(
                "{:.1} % of the frames end more than 0.3 dB apart, by their start",
                100.0 * apart
            );
        }
        let percent = |share: f64| fixed(100.0 * share, 1);
        let degrees = |axis: &Axis, value: f64| match axis.name.starts_with("about") {
            true => format!("{:.4}°", value.to_degrees()),
            false => format!("{value:.5}"),
        };
        let table = Table::of(
            &run.axes,
            &[
                ("axis", &|axis| axis.name.to_owned()),
                ("error, median", &|axis| degrees(axis, axis.error)),
                ("stated, median", &|axis| degrees(axis, axis.deviation)),
                ("stated / error", &|axis| fixed(axis.deviation / axis.error, 2)),
                ("within 2, %", &|axis| percent(axis.within_2)),
                ("within 4, %", &|axis| percent(axis.within_4)),
                ("open, %", &|axis| percent(axis.open)),
            ],
        );
        table.print();
    }
}
