//! The paper's table: size, ratio, PSNR, time.

use std::fmt;
use std::path::Path;

use anyhow::Context as _;
use nvsprior::Camera;
use serde_json::{Value, json};

/// What one frame took.
#[derive(Clone, Copy)]
pub struct Figures {
    pub bytes: usize,
    pub psnr: f64,
    pub milliseconds: f64,
    pub renders: u32,
}

/// Means over the frames of a run.
pub struct Table {
    pub camera: Camera,
    pub run: &'static str,
    pub frames: usize,
    /// Whether the run has more frames than these.
    pub is_part: bool,
    pub rows: Vec<TableRow>,
}

/// One method: means over frames.
pub struct TableRow {
    method: String,
    bytes: f64,
    pub psnr: f64,
    milliseconds: f64,
    renders: f64,
}

impl TableRow {
    pub fn mean_of(method: impl Into<String>, frames: &[Figures]) -> TableRow {
        let mean = |figure: fn(&Figures) -> f64| {
            frames.iter().map(figure).sum::<f64>() / frames.len().max(1) as f64
        };
        TableRow {
            method: method.into(),
            bytes: mean(|frame| frame.bytes as f64),
            psnr: mean(|frame| frame.psnr),
            milliseconds: mean(|frame| frame.milliseconds),
            renders: mean(|frame| f64::from(frame.renders)),
        }
    }
}

impl Table {
    /// How many times as many bytes the picture has without compression.
    fn ratio(&self, row: &TableRow) -> f64 {
        (self.camera.pixels() * 3) as f64 / row.bytes
    }

    /// Its rows for other programs.
    fn values(&self) -> impl Iterator<Item = Value> {
        self.rows.iter().map(|row| {
            json!({
                "run": self.run,
                "frames": self.frames,
                "method": row.method,
                "bytes": row.bytes,
                "ratio": self.ratio(row),
                "psnr": row.psnr,
                "milliseconds": row.milliseconds,
                "renders": row.renders,
            })
        })
    }
}

/// Writes table.txt and table.json to a folder.
pub fn write(folder: &Path, tables: &[Table]) -> anyhow::Result<()> {
    let text: String = tables.iter().map(|table| format!("{table}\n")).collect();
    let values: Vec<Value> = tables.iter().flat_map(Table::values).collect();
    for (name, bytes) in
        [("table.txt", text.into_bytes()), ("table.json", serde_json::to_vec_pretty(&values)?)]
    {
        let path = folder.join(name);
        std::fs::write(&path, bytes).with_context(|| format!("writing {}", path.display()))?;
    }
    Ok(())
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Camera { width, height, .. } = self.camera;
        match (self.is_part, self.frames) {
            (true, 1) => write!(f, "{}, its first frame alone, {width}×{height}", self.run)?,
            (true, frames) => {
                write!(f, "{}, its first {frames} frames of {width}×{height}", self.run)?
            }
            (false, frames) => write!(f, "{}, {frames} frames of {width}×{height}", self.run)?,
        }
        write!(
            f,
            "\n{:36} {:>12} {:>8} {:>10} {:>10} {:>8}",
            "method", "size, bytes", "ratio", "PSNR, dB", "time, ms", "renders"
        )?;
        for row in &self.rows {
            write!(
                f,
                "\n{:36} {:12.0} {:8.1} {:10.2} {:10.1} {:8.1}",
                row.method,
                row.bytes,
                self.ratio(row),
                row.psnr,
                row.milliseconds,
                row.renders
            )?;
        }
        Ok(())
    }
}
