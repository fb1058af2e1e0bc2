//! The wavelet coder beside WebP on each single frame, at equal bytes.

use std::path::Path;
use std::sync::Arc;

use nvsprior::coder_tables::Tables;
use nvsprior::packet::residual_part_len;
use nvsprior::residual::{Rate, ResidualEncoder, ResidualSetup, Tune};

use super::run::Run;
use nvsprior_inputs::report::{Table, fixed};
use nvsprior_paper::WebpEncoder;

/// WebP's qualities. Each gives a frame's bytes, with which the wavelet coder must do.
pub const QUALITIES: [f32; 9] = [0.0, 2.0, 6.0, 15.0, 25.0, 35.0, 50.0, 65.0, 85.0];

/// A frame with as many bytes as WebP takes at a quality.
pub struct Row {
    frame: String,
    quality: f32,
    webp: Coded,
    wavelet: Coded,
}

#[derive(Clone, Copy)]
struct Coded {
    /// Of the payload.
    bytes: usize,
    psnr: f64,
}

impl Row {
    /// How much better the wavelet coder's picture is, dB.
    fn gain(&self) -> f64 {
        self.wavelet.psnr - self.webp.psnr
    }
}

/// Codes each frame at each of [`QUALITIES`]. `names`: the frames' files.
pub fn measure<'a>(
    run: &Run,
    names: impl Iterator<Item = &'a str>,
    tables: &Arc<Tables>,
    portable: bool,
    done: impl Fn(),
) -> anyhow::Result<Vec<Row>> {
    let (width, height) = (run.frames[0].width, run.frames[0].height);
    let tables = tables.clone();
    let setup = ResidualSetup { width, height, tune: Tune::Psnr, tables, portable };
    let (mut webp, mut wavelet) = (WebpEncoder::new(width, height), ResidualEncoder::new(&setup));
    let mut rows = Vec::new();
    for ((frame, render), name) in run.frames.iter().zip(&run.renders).zip(names) {
        for quality in QUALITIES {
            let coded = webp.encode(frame, render, Rate::Quality(quality), 0)?;
            let bytes = coded.payload.map_or(0, |payload| payload.bytes.len());
            let webp = Coded { bytes, psnr: coded.psnr };
            let budget = Rate::Bytes(residual_part_len(bytes));
            let coded = wavelet.encode(frame, render, budget, 0)?;
            let wavelet = Coded { bytes: coded.residual.payload().len(), psnr: coded.psnr };
            anyhow::ensure!(wavelet.bytes <= webp.bytes, "{name}: more bytes than the budget");
            rows.push(Row { frame: name.into(), quality, webp, wavelet });
        }
        done();
    }
    Ok(rows)
}

/// Prints the least gain, and how many there are below zero.
pub fn print(rows: &[Row]) {
    let Some(min) = rows.iter().min_by(|a, b| a.gain().total_cmp(&b.gain())) else { return };
    let worse = rows.iter().filter(|row| row.gain() < 0.0).count();
    println!(
        "frame by frame, with WebP's bytes: the wavelet coder is worse in {worse} of {} cases; the least gain is \
            {:+.2} dB, \
         {} with {} bytes",
        rows.len(),
        min.gain(),
        min.frame,
        min.webp.bytes
    );
}

pub fn write(path: &Path, rows: &[Row]) -> anyhow::Result<()> {
    let table = Table::of(
        rows,
        &[
            ("frame", &|r| r.frame.clone()),
            ("webp_quality", &|r| r.quality.to_string()),
            ("webp_bytes", &|r| r.webp.bytes.to_string()),
            ("webp_psnr", &|r| fixed(r.webp.psnr, 3)),
            ("wavelet_bytes", &|r| r.wavelet.bytes.to_string()),
            ("wavelet_psnr", &|r| fixed(r.wavelet.psnr, 3)),
        ],
    );
    table.write_csv(path)
}
