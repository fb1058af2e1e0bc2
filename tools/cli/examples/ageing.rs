//! How many bytes a frame takes as the site ages, and what streams and mapping anew do about it.
//!
//!     make ageing
//!     cargo run --release -p nvsprior-cli --example ageing -- PROGRAMS PRIOR OUT [FRAMES [RATE]]
//!
//! Five dives of the basin, 0 to 26 weeks after the mapping run, FRAMES (40) each at RATE (3) per second, 33 dB. Each
//! way runs the programs in the folder PROGRAMS as a person would. OUT gets a folder for each dive and way,
//! `ageing.csv` and `ageing.svg`. Bytes are means per frame. What is there already is not done again.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use anyhow::{Context, ensure};
use plotters::prelude::*;
use serde_json::Value;

/// Weeks since the mapping run, a dive each.
const WEEKS: [u32; 5] = [0, 3, 8, 16, 26];
/// What every frame must reach, dB.
const PSNR: &str = "33";

/// A way to go about it.
struct Way {
    name: &'static str,
    folder: &'static str,
    /// Encodes as a stream.
    is_stream: bool,
    /// Trains the prior with each dive's pictures, for the next one.
    maps: bool,
}

const WAYS: [Way; 3] = [
    Way { name: "intra frames", folder: "none", is_stream: false, maps: false },
    Way { name: "a stream", folder: "stream", is_stream: true, maps: false },
    Way { name: "mapped after each dive", folder: "mapped", is_stream: false, maps: true },
];

/// The runs of the programs.
struct Site {
    programs: PathBuf,
    out: PathBuf,
    frames: String,
    rate: String,
}

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [programs, prior, out, options @ ..] = &arguments[..] else {
        anyhow::bail!("PROGRAMS PRIOR OUT [FRAMES [RATE]]");
    };
    let option = |at: usize, usual: &str| options.get(at).map_or(usual, String::as_str).to_owned();
    let (frames, rate) = (option(0, "40"), option(1, "3"));
    let site = Site { programs: programs.into(), out: out.into(), frames, rate };
    std::fs::create_dir_all(&site.out).with_context(|| out.clone())?;
    for dive in 1..=WEEKS.len() {
        site.draw(dive)?;
    }
    let mut curves = Vec::new();
    for way in &WAYS {
        let mut before = PathBuf::from(prior);
        let mut bytes = Vec::new();
        for dive in 1..=WEEKS.len() {
            let since = Instant::now();
            bytes.push(site.encode(way, dive, &before)?);
            let last = dive == WEEKS.len();
            before = if last { before } else { site.go_on(way, dive, &before)? };
            println!("{}, dive {dive}: {:.0} s", way.name, since.elapsed().as_secs_f64());
        }
        curves.push(bytes);
    }
    let table = table(&curves);
    print!("{table}");
    std::fs::write(site.out.join("ageing.csv"), table)?;
    draw(&site.out.join("ageing.svg"), &curves)
}

impl Site {
    /// Runs a program, unless the file that it ends with is there.
    fn run(&self, program: &str, arguments: &str, last: &str) -> anyhow::Result<()> {
        if Path::new(last).exists() {
            return Ok(());
        }
        let program = self.programs.join(program);
        let output = Command::new(&program).args(arguments.split_whitespace()).output();
        let output = output.with_context(|| program.display().to_string())?;
        let said = String::from_utf8_lossy(&output.stderr);
        ensure!(output.status.success(), "{} {arguments}: {said}", program.display());
        Ok(())
    }

    fn folder(&self, dive: usize, way: &str) -> String {
        self.out.join(format!("dive-{dive}")).join(way).display().to_string()
    }

    fn cameras(&self, dive: usize) -> String {
        format!("{}/T4/cameras.json", self.folder(dive, ""))
    }

    fn draw(&self, dive: usize) -> anyhow::Result<()> {
        let (Site { frames, rate, .. }, weeks) = (self, WEEKS[dive - 1]);
        let out = self.folder(dive, "");
        let what = format!("--run T4 --dive {dive} --age {weeks} --frames {frames} --rate {rate}");
        self.run("nvsprior-lab", &format!("draw {what} --out {out}"), &self.cameras(dive))
    }

    /// Encodes a dive; mean bytes of a frame.
    fn encode(&self, way: &Way, dive: usize, prior: &Path) -> anyhow::Result<f64> {
        let (folder, cameras) = (self.folder(dive, way.folder), self.cameras(dive));
        let mode = if way.is_stream { "--mode stream" } else { "" };
        let summary = format!("{folder}/summary.json");
        let files = format!("--packets {folder} --summary {summary}");
        let input = format!("--prior {} --cameras {cameras}", prior.display());
        self.run("nvsprior", &format!("encode {input} --psnr {PSNR} {mode} {files}"), &summary)?;
        let summary = std::fs::read_to_string(summary)?;
        let summary: Value = serde_json::from_str(&summary)?;
        let frames = summary["frames"].as_array().context("no frames")?;
        let bytes = frames.iter().map(|frame| frame["bytes"].as_f64().unwrap_or(f64::NAN));
        Ok(bytes.sum::<f64>() / frames.len() as f64)
    }

    /// The prior of the next dive.
    fn go_on(&self, way: &Way, dive: usize, prior: &Path) -> anyhow::Result<PathBuf> {
        if !way.maps {
            return Ok(prior.to_path_buf());
        }
        let next = format!("{}/next.nvsg", self.folder(dive, way.folder));
        let input = format!("--from {} --cameras {}", prior.display(), self.cameras(dive));
        self.run("nvsprior", &format!("map {input} --held-out 0 --out {next}"), &next)?;
        Ok(next.into())
    }
}

fn table(curves: &[Vec<f64>]) -> String {
    let names = WAYS.map(|way| way.name).join(",");
    let row = |(dive, weeks): (usize, u32)| {
        let bytes = curves.iter().map(|bytes| format!("{:.0}", bytes[dive]));
        format!("{weeks},{}\n", bytes.collect::<Vec<_>>().join(","))
    };
    let rows: String = WEEKS.into_iter().enumerate().map(row).collect();
    format!("weeks,{names}\n{rows}")
}

/// Bytes against weeks, a curve for each way.
fn draw(path: &Path, curves: &[Vec<f64>]) -> anyhow::Result<()> {
    let root = SVGBackend::new(path, (900, 560)).into_drawing_area();
    root.fill(&WHITE)?;
    let most = curves.iter().flatten().fold(1.0, |a: f64, b| a.max(*b));
    let weeks = f64::from(WEEKS[WEEKS.len() - 1]);
    let mut chart = ChartBuilder::on(&root)
        .caption("Bytes of a frame at 33 dB as the site ages", ("sans-serif", 20))
        .margin(16)
        .x_label_area_size(44)
        .y_label_area_size(64)
        // The names have their place above the curves.
        .build_cartesian_2d(0.0..weeks, 0.0..1.5 * most)?;
    chart.configure_mesh().x_desc("weeks since the mapping run").y_desc("bytes").draw()?;
    for (k, (bytes, way)) in curves.iter().zip(&WAYS).enumerate() {
        let colour = Palette99::pick(k).to_rgba();
        let points = || WEEKS.into_iter().map(f64::from).zip(bytes.iter().copied());
        chart.draw_series(points().map(|point| Circle::new(point, 3, colour.filled())))?;
        chart
            .draw_series(LineSeries::new(points(), colour.stroke_width(2)))?
            .label(way.name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 20, y)], colour.stroke_width(2)));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperLeft)
        .background_style(WHITE.mix(0.8))
        .border_style(BLACK)
        .draw()?;
    Ok(root.present()?)
}
