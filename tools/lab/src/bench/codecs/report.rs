//! The coders' figures: printed, as JSON, CSV and a plot.

use std::path::Path;

use anyhow::Context as _;
use serde_json::{Value, json};

use super::point::{Mode, Point};
use super::rates::{Best, Curve, LEVELS, Row, best_others, rows};
use super::run::Run;
use crate::bench::plot;

/// A coder without points, and why it has none.
pub struct Missing {
    pub coder: &'static str,
    pub why: String,
}

/// Prints the points, the coders side by side, and what was not measured.
pub fn print(run: &Run, points: &[Point], missing: &[Missing]) {
    let curves = Curve::all(points);
    println!("bytes and PSNR are means per frame");
    println!("bytes of a difference picture include what a steady packet adds to the payload");
    for curve in &curves {
        let points: Vec<String> =
            curve.points.iter().map(|p| format!("{:.0} at {:.2}", p.bytes, p.psnr)).collect();
        println!("{}: {} dB", curve.name(), points.join(", "));
    }
    println!("the renders alone: {:.2} dB", run.psnr(&run.renders));
    let rows = rows(&curves);
    print_rows(&rows);
    print_best("best other, picture by picture", &best_others(&rows, &[Mode::Intra]));
    print_best("best other, streams too", &best_others(&rows, &[Mode::Intra, Mode::Stream]));
    for Missing { coder, why } in missing {
        println!("{coder}: {why}");
    }
}

/// Prints the best other coders, and the wavelet coder's share of their bytes.
fn print_best(title: &str, best: &[Best]) {
    println!("{title}:");
    for Best { psnr, curve, bytes, share } in best {
        let percent = 100.0 * share;
        println!("  {psnr} dB: {bytes:.0}, {}; wavelet has {percent:.0} %", curve.name());
    }
}

/// Prints bytes at the same PSNR, and the wavelet coder's BD-rate beside each coder.
fn print_rows(rows: &[Row]) {
    let levels: String = LEVELS.iter().map(|psnr| format!("{psnr:>5} dB")).collect();
    println!("{:<17} {:<10} {:<6} {levels}  wavelet's BD-rate", "coder", "input", "mode");
    for Row { curve, bd_rate, bytes } in rows {
        let number = |bytes: &Option<f64>| bytes.map_or("-".into(), |bytes| format!("{bytes:.0}"));
        let bytes: String = bytes.iter().map(|bytes| format!("{:>8}", number(bytes))).collect();
        let rate = bd_rate.map_or("-".into(), |rate| format!("{:+.1} %", 100.0 * rate));
        let (input, mode) = (curve.input.name(), curve.mode.name());
        println!("{:<17} {input:<10} {mode:<6} {bytes}  {rate}", curve.coder);
    }
}

/// Writes codecs.json, codecs-missing.json, codecs.csv, codecs-rates.csv and codecs.svg.
pub fn write(folder: &Path, points: &[Point], missing: &[Missing]) -> anyhow::Result<()> {
    list(&folder.join("codecs.json"), points.iter().map(row))?;
    list(&folder.join("codecs-missing.json"), missing.iter().map(absent))?;
    table(&folder.join("codecs.csv"), points)?;
    let curves = Curve::all(points);
    rates_table(&folder.join("codecs-rates.csv"), &rows(&curves))?;
    let named = curves
        .iter()
        .map(|curve| (curve.name(), curve.points.iter().map(|p| (p.bytes, p.psnr)).collect()));
    plot::codecs(&folder.join("codecs.svg"), named.collect())
}

fn list(path: &Path, rows: impl Iterator<Item = Value>) -> anyhow::Result<()> {
    let text = serde_json::to_string_pretty(&rows.collect::<Vec<_>>())? + "\n";
    std::fs::write(path, text).with_context(|| format!("writing {}", path.display()))
}

fn row(p: &Point) -> Value {
    json!({
        "coder": p.coder,
        "input": p.input.name(),
        "mode": p.mode.name(),
        "setting": p.setting,
        "bytes": p.bytes,
        "psnr": p.psnr,
        "encode_ms": p.encode_ms,
        "decode_ms": p.decode_ms,
    })
}

fn absent(Missing { coder, why }: &Missing) -> Value {
    json!({ "coder": coder, "missing": why })
}

fn table(path: &Path, points: &[Point]) -> anyhow::Result<()> {
    let writing = || format!("writing {}", path.display());
    let mut table = csv::Writer::from_path(path).with_context(writing)?;
    table.write_record([
        "coder",
        "input",
        "mode",
        "setting",
        "bytes",
        "psnr",
        "encode_ms",
        "decode_ms",
    ])?;
    for p in points {
        let numbers = [p.setting, p.bytes, p.psnr, p.encode_ms, p.decode_ms];
        let numbers = numbers.map(|v| format!("{v:.3}"));
        let words = [p.coder, p.input.name(), p.mode.name()].map(String::from);
        table.write_record(words.iter().chain(&numbers))?;
    }
    table.flush().with_context(writing)
}

/// Bytes at the same PSNR, and the wavelet coder's BD-rate beside each coder; empty if there is none.
fn rates_table(path: &Path, rows: &[Row]) -> anyhow::Result<()> {
    let writing = || format!("writing {}", path.display());
    let mut table = csv::Writer::from_path(path).with_context(writing)?;
    let words = ["coder", "input", "mode", "wavelet_bd_rate"].map(String::from);
    let levels = LEVELS.map(|psnr| format!("bytes_at_{psnr}_db"));
    table.write_record(words.iter().chain(&levels))?;
    for Row { curve, bd_rate, bytes } in rows {
        let words = [curve.coder, curve.input.name(), curve.mode.name()].map(String::from);
        let rate = bd_rate.map_or(String::new(), |rate| format!("{rate:.4}"));
        let bytes = bytes.map(|bytes| bytes.map_or(String::new(), |bytes| format!("{bytes:.1}")));
        table.write_record(words.iter().chain([&rate]).chain(&bytes))?;
    }
    table.flush().with_context(writing)
}
