//! The paper's table: size, ratio, PSNR, time.

use std::fmt;
use std::path::Path;

use anyhow::Context as _;
use nvsprior::Camera;
use nvsprior_lab::report::write_json;
use serde_json::{Value, json};

/// Means over the frames of a run.
pub struct Table {
    pub camera: Camera,
    pub run: &'static str,
    pub frames: usize,
    pub rows: Vec<TableRow>,
}

/// One method: sums while it is filled, means after [`TableRow::mean`].
pub struct TableRow {
    method: String,
    bytes: f64,
    pub psnr: f64,
    milliseconds: f64,
    renders: f64,
}

impl TableRow {
    pub fn new(method: impl Into<String>) -> TableRow {
        TableRow { method: method.into(), bytes: 0.0, psnr: 0.0, milliseconds: 0.0, renders: 0.0 }
    }

    pub fn add(&mut self, bytes: usize, psnr: f64, milliseconds: f64, renders: u32) {
        self.bytes += bytes as f64;
        self.psnr += psnr;
        self.milliseconds += milliseconds;
        self.renders += f64::from(renders);
    }

    pub fn mean(self, frames: usize) -> TableRow {
        let n = frames.max(1) as f64;
        TableRow {
            bytes: self.bytes / n,
            psnr: self.psnr / n,
            milliseconds: self.milliseconds / n,
            renders: self.renders / n,
            ..self
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
    let path = folder.join("table.txt");
    let text: String = tables.iter().map(|table| format!("{table}\n")).collect();
    std::fs::write(&path, text).with_context(|| format!("writing {}", path.display()))?;
    let values: Vec<Value> = tables.iter().flat_map(Table::values).collect();
    write_json(&folder.join("table.json"), &values)
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Camera { width, height, .. } = self.camera;
        writeln!(f, "{}, {} frames of {width}×{height}", self.run, self.frames)?;
        write!(
            f,
            "{:36} {:>12} {:>8} {:>10} {:>10} {:>8}",
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
