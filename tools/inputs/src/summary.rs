//! The per-frame summary of an encoding run, as JSON and as a table.

use std::path::Path;

use crate::report::write_json;
use nvsprior::{FrameStats, Pose};
use serde_json::{Value, json};

/// A frame's file name and figures.
pub struct Row {
    pub file: String,
    /// When it was taken, seconds, if that is known.
    pub time: Option<f64>,
    /// As the packet holds it.
    pub pose: Pose,
    pub stats: FrameStats,
}

/// A figure's name, and how to take it from a frame's.
type Figure = (&'static str, fn(&FrameStats) -> f64);

/// The figures that have a mean.
const FIGURES: [Figure; 8] = [
    ("bytes", |s| s.bytes as f64),
    ("latent_bytes", |s| s.latent_bytes as f64),
    ("render_psnr", |s| s.render_psnr),
    ("psnr", |s| s.psnr),
    ("full_renders", |s| f64::from(s.full_renders)),
    ("milliseconds", |s| s.milliseconds),
    ("truth_bytes", |s| s.truth_bytes as f64),
    // The share of them.
    ("certain", |s| f64::from(u8::from(s.certain))),
];

/// Mean of a figure over rows; 0 if there are none.
pub fn mean(rows: &[Row], figure: impl Fn(&FrameStats) -> f64) -> f64 {
    let sum: f64 = rows.iter().map(|row| figure(&row.stats)).sum();
    sum / rows.len().max(1) as f64
}

fn frame(row: &Row) -> Value {
    let s = &row.stats;
    json!({
        "file": row.file,
        "time": row.time,
        "bytes": s.bytes,
        "latent_bytes": s.latent_bytes,
        "truth_bytes": s.truth_bytes,
        "render_psnr": s.render_psnr,
        "psnr": s.psnr,
        // The PSNR within --region; null without it.
        "interest_psnr": s.interest_psnr,
        "full_renders": s.full_renders,
        "renders_by_level": s.renders,
        "milliseconds": s.milliseconds,
        "start": s.start.name(),
        "certain": s.certain,
        "out_of_time": s.out_of_time,
        "portable": s.portable,
        "lost_frames": s.frames_since_certain,
        "rate_kept": s.rate_kept,
        // Its reference frame.
        "reference": s.reference,
        // Whether the packet says that the position is known, and within how much.
        "position_known": s.known.is_some(),
        "known_within": s.known.map(|known| [known.position, known.rotation]),
        // Infinite ones, of open axes, become null.
        "pose_deviation": s.pose_deviation(),
    })
}

/// Writes `{"frames": […], "mean": {…}}`.
pub fn write(path: &Path, rows: &[Row]) -> anyhow::Result<()> {
    let means = FIGURES.map(|(name, figure)| (name.to_owned(), json!(mean(rows, figure))));
    let summary = json!({
        "frames": rows.iter().map(frame).collect::<Vec<_>>(),
        "mean": Value::Object(means.into_iter().collect()),
    });
    write_json(path, &summary)
}

pub fn print(rows: &[Row]) {
    say!(
        "{:24} {:>7} {:>9} {:>9} {:>8} {:>9}  start",
        "frame",
        "bytes",
        "render dB",
        "PSNR dB",
        "renders",
        "ms"
    );
    for Row { file, stats: s, .. } in rows {
        say!(
            "{file:24} {:7} {:9.2} {:9.2} {:8} {:9.1}  {}{}{}{}",
            s.bytes,
            s.render_psnr,
            s.psnr,
            s.full_renders,
            s.milliseconds,
            s.start.name(),
            s.reference.map_or(String::new(), |frame| format!(", predicted from frame {frame}")),
            if s.certain { "" } else { ", NOT CERTAIN" },
            if s.rate_kept { "" } else { ", rate not kept" },
        );
    }
    let [bytes, _, render, psnr, renders, ms, ..] = FIGURES.map(|(_, figure)| mean(rows, figure));
    say!("{:24} {bytes:7.0} {render:9.2} {psnr:9.2} {renders:8.1} {ms:9.1}", "mean");
    let lost = rows.iter().filter(|row| !row.stats.certain).count();
    if lost > 0 {
        say!(
            "not certain: {lost} of {} frames; their pictures do not confirm the pose",
            rows.len()
        );
    }
}
