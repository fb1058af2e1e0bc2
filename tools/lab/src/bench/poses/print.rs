//! What `nvsprior-lab poses` prints.

use super::{Axis, Summary};
use nvsprior_inputs::report::{Table, fixed};

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
