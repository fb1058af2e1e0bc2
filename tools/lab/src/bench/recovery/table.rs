//! Every frame that an encoder got, as CSV.

use std::path::Path;

use super::probe::{Answer, Frame, Run};
use nvsprior_inputs::report::{Table, fixed, fixed_or_empty};

/// Writes a row per frame; what there is not stays empty.
pub fn write(path: &Path, runs: &[Run]) -> anyhow::Result<()> {
    let frames = runs.iter().flat_map(|run| run.frames.iter().enumerate().map(move |f| (run, f)));
    let rows: Vec<(&Run, (usize, &Frame))> = frames.collect();
    let answer = |frame: &Frame, text: &dyn Fn(&Answer) -> String| {
        frame.answer.as_ref().map_or(String::new(), text)
    };
    let table = Table::of(
        &rows,
        &[
            ("measurement", &|(run, _)| run.measurement.name().to_owned()),
            ("column", &|(run, _)| run.column.clone()),
            ("trial", &|(run, _)| run.number.to_string()),
            ("detail", &|(run, _)| run.detail.clone()),
            ("frame", &|(_, (index, _))| index.to_string()),
            ("phase", &|(_, (_, f))| f.phase.name().to_owned()),
            ("file", &|(_, (_, f))| f.file.clone()),
            ("best_psnr", &|(_, (_, f))| fixed_or_empty(f.best_psnr, 4)),
            ("clean_psnr", &|(_, (_, f))| answer(f, &|a| fixed(a.psnr, 4))),
            ("db_short", &|(_, (_, f))| fixed_or_empty(f.short(), 4)),
            ("found", &|(_, (_, f))| f.found().to_string()),
            ("wrong", &|(_, (_, f))| f.wrong().to_string()),
            ("certain", &|(_, (_, f))| f.certain().to_string()),
            ("false_certain", &|(_, (_, f))| f.false_certain().to_string()),
            ("no_start", &|(_, (_, f))| f.no_start().to_string()),
            ("start", &|(_, (_, f))| answer(f, &|a| a.start.to_owned())),
            ("lost_frames", &|(_, (_, f))| answer(f, &|a| a.frames_since_certain.to_string())),
            ("renders", &|(_, (_, f))| answer(f, &|a| a.renders.to_string())),
            ("full_renders", &|(_, (_, f))| answer(f, &|a| a.full_renders.to_string())),
            ("milliseconds", &|(_, (_, f))| fixed(f.milliseconds, 3)),
            ("in_forward_renders", &|(_, (_, f))| fixed(f.in_forward_renders(), 3)),
            ("pose_error_units", &|(_, (_, f))| answer(f, &|a| fixed(a.pose_error[0], 5))),
            ("pose_error_degrees", &|(_, (_, f))| answer(f, &|a| fixed(a.pose_error[1], 5))),
        ],
    );
    table.write_csv(path)
}
