//! Every frame that an encoder got, as CSV.

use std::path::Path;

use anyhow::Context as _;

use super::probe::{Answer, Frame, Run};

const COLUMNS: [&str; 23] = [
    "measurement",
    "column",
    "trial",
    "detail",
    "frame",
    "phase",
    "file",
    "best_psnr",
    "clean_psnr",
    "db_short",
    "found",
    "wrong",
    "certain",
    "false_certain",
    "no_start",
    "start",
    "lost_frames",
    "renders",
    "full_renders",
    "milliseconds",
    "in_forward_renders",
    "pose_error_units",
    "pose_error_degrees",
];

/// Writes a row per frame; what there is not stays empty.
pub fn write(path: &Path, runs: &[Run]) -> anyhow::Result<()> {
    let write = || {
        let mut csv = csv::Writer::from_path(path)?;
        csv.write_record(COLUMNS)?;
        for run in runs {
            for (index, frame) in run.frames.iter().enumerate() {
                csv.write_record(row(run, index, frame))?;
            }
        }
        Ok::<_, csv::Error>(csv.flush()?)
    };
    write().with_context(|| format!("writing {}", path.display()))
}

fn row(run: &Run, index: usize, frame: &Frame) -> [String; COLUMNS.len()] {
    let answer =
        |text: &dyn Fn(&Answer) -> String| frame.answer.as_ref().map_or(String::new(), text);
    let decibels = |value: Option<f64>| value.map_or(String::new(), |v| format!("{v:.4}"));
    [
        run.measurement.name().to_owned(),
        run.column.clone(),
        run.number.to_string(),
        run.detail.clone(),
        index.to_string(),
        frame.phase.name().to_owned(),
        frame.file.clone(),
        decibels(frame.best_psnr),
        answer(&|a| format!("{:.4}", a.psnr)),
        decibels(frame.short()),
        frame.found().to_string(),
        frame.wrong().to_string(),
        frame.certain().to_string(),
        frame.false_certain().to_string(),
        frame.no_start().to_string(),
        answer(&|a| a.start.to_owned()),
        answer(&|a| a.lost_frames.to_string()),
        answer(&|a| a.renders.to_string()),
        answer(&|a| a.full_renders.to_string()),
        format!("{:.3}", frame.milliseconds),
        format!("{:.3}", frame.in_forward_renders()),
        answer(&|a| format!("{:.5}", a.pose_error[0])),
        answer(&|a| format!("{:.5}", a.pose_error[1])),
    ]
}
