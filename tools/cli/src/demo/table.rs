//! The paper's table: size, ratio, PSNR, time.

use std::fmt;

use nvsprior::Camera;

/// Means over the frames of a run.
pub struct Table {
    pub camera: Camera,
    pub title: String,
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

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let raw = (self.camera.pixels() * 3) as f64;
        writeln!(f, "{}", self.title)?;
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
                raw / row.bytes,
                row.psnr,
                row.milliseconds,
                row.renders
            )?;
        }
        Ok(())
    }
}
