//! The coders' figures: printed, as JSON, CSV and a plot.

use std::path::Path;

use anyhow::Context as _;
use serde_json::{Value, json};

use super::point::{Input, Mode, Point, bd_rate};
use crate::bench::plot;

/// A coder that is not installed, and what it needs.
type Missing = (&'static str, &'static str);

/// Points of one coder, input and mode.
struct Curve<'a> {
    coder: &'static str,
    input: Input,
    mode: Mode,
    points: Vec<&'a Point>,
}

fn curves(points: &[Point]) -> Vec<Curve<'_>> {
    let mut curves: Vec<Curve> = Vec::new();
    for point in points {
        let Point { coder, input, mode, .. } = *point;
        let same = |c: &&mut Curve| (c.coder, c.input, c.mode) == (coder, input, mode);
        match curves.iter_mut().find(same) {
            Some(curve) => curve.points.push(point),
            None => curves.push(Curve { coder, input, mode, points: vec![point] }),
        }
    }
    curves
}

/// Bytes beyond those of WebP on the difference, which is the paper's way.
fn beside_webp(curves: &[Curve], curve: &Curve) -> Option<f64> {
    let is_webp = |c: &&Curve| c.coder == "webp" && c.input == Input::Difference;
    let webp = curves.iter().find(is_webp)?;
    bd_rate(&curve.points, &webp.points)
}

/// Prints a table, and what is not installed.
pub fn print(points: &[Point], missing: &[Missing]) {
    let curves = curves(points);
    println!("bytes and PSNR are means per frame; of a difference picture with its latent part");
    println!("BD-rate is beside WebP on the difference picture");
    println!("{:<10} {:<10} {:<6} {:>9}  points: bytes at dB", "coder", "input", "mode", "BD-rate");
    for curve in &curves {
        let rate = beside_webp(&curves, curve);
        let rate = rate.map_or("-".into(), |r| format!("{:+.0} %", 100.0 * r));
        let points: Vec<String> =
            curve.points.iter().map(|p| format!("{:.0} at {:.2}", p.bytes, p.psnr)).collect();
        let (input, mode) = (curve.input.name(), curve.mode.name());
        println!("{:<10} {input:<10} {mode:<6} {rate:>9}  {}", curve.coder, points.join(", "));
    }
    for (coder, needs) in missing {
        println!("{coder}: not installed; needs {needs}");
    }
}

/// Writes codecs.json, codecs.csv and codecs.svg.
pub fn write(folder: &Path, points: &[Point], missing: &[Missing]) -> anyhow::Result<()> {
    let path = folder.join("codecs.json");
    let rows: Vec<Value> = points.iter().map(row).chain(missing.iter().map(absent)).collect();
    let text = serde_json::to_string_pretty(&rows)? + "\n";
    std::fs::write(&path, text).with_context(|| format!("writing {}", path.display()))?;
    table(&folder.join("codecs.csv"), points)?;
    let curves = curves(points);
    let named = curves.iter().map(|curve| {
        let name = format!("{}, {}, {}", curve.coder, curve.input.name(), curve.mode.name());
        (name, curve.points.iter().map(|p| (p.bytes, p.psnr)).collect())
    });
    plot::codecs(&folder.join("codecs.svg"), named.collect())
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

fn absent((coder, needs): &Missing) -> Value {
    json!({ "coder": coder, "missing": needs })
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
