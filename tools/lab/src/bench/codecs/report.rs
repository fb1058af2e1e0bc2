//! The coders' figures: printed, as JSON, CSV and a plot.

use std::path::Path;

use serde::Serialize;

use super::alike;
use super::point::{Mode, Point};
use super::rates::{Best, Curve, LEVELS, Row, best_others, rows};
use super::run::Run;
use crate::bench::plot;
use nvsprior_inputs::report::{Table, fixed, fixed_or_empty, write_json};

/// A coder without points, and why it has none.
#[derive(Serialize)]
pub struct Missing {
    pub coder: &'static str,
    #[serde(rename = "missing")]
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
    rates_table(&rows).print();
    print_best("best other, picture by picture", &best_others(&rows, &[Mode::Intra]));
    print_best("best other, streams too", &best_others(&rows, &[Mode::Intra, Mode::Stream]));
    println!("at equal bytes and at equal PSNR, difference pictures, picture by picture:");
    alike::table(&curves).print();
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

/// Writes codecs.json, codecs-missing.json, codecs.csv, codecs-rates.csv, codecs-similarity.csv and codecs.svg.
pub fn write(folder: &Path, points: &[Point], missing: &[Missing]) -> anyhow::Result<()> {
    write_json(&folder.join("codecs.json"), &points)?;
    write_json(&folder.join("codecs-missing.json"), &missing)?;
    table(points).write_csv(&folder.join("codecs.csv"))?;
    let curves = Curve::all(points);
    rates_table(&rows(&curves)).write_csv(&folder.join("codecs-rates.csv"))?;
    alike::table(&curves).write_csv(&folder.join("codecs-similarity.csv"))?;
    let named = curves
        .iter()
        .map(|curve| (curve.name(), curve.points.iter().map(|p| (p.bytes, p.psnr)).collect()));
    plot::codecs(&folder.join("codecs.svg"), named.collect())
}

fn table(points: &[Point]) -> Table {
    Table::of(
        points,
        &[
            ("coder", &|p| p.coder.to_string()),
            ("input", &|p| p.input.name().to_owned()),
            ("mode", &|p| p.mode.name().to_owned()),
            ("setting", &|p| fixed(p.setting, 3)),
            ("bytes", &|p| fixed(p.bytes, 3)),
            ("psnr", &|p| fixed(p.psnr, 3)),
            ("ssim", &|p| fixed_or_empty(p.similarity.ssim, 5)),
            ("ms_ssim", &|p| fixed_or_empty(p.similarity.ms_ssim, 5)),
            ("encode_ms", &|p| fixed(p.encode_ms, 3)),
            ("decode_ms", &|p| fixed(p.decode_ms, 3)),
        ],
    )
}

/// Bytes at the same PSNR, and the wavelet coder's BD-rate beside each coder; empty if there is none.
fn rates_table(rows: &[Row]) -> Table {
    let words = ["coder", "input", "mode", "wavelet_bd_rate"].map(String::from);
    let levels = LEVELS.map(|psnr| format!("bytes_at_{psnr}_db"));
    let mut table = Table::new(words.iter().chain(&levels));
    for Row { curve, bd_rate, bytes } in rows {
        let words = [curve.coder, curve.input.name(), curve.mode.name()].map(String::from);
        let numbers = [fixed_or_empty(*bd_rate, 4)];
        let bytes = bytes.map(|bytes| fixed_or_empty(bytes, 1));
        table.push(words.into_iter().chain(numbers).chain(bytes));
    }
    table
}
