//! `nvsprior-lab site`: time and memory of priors in blocks, by the size of the site.

mod flight;
mod measured;
mod tiled;

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, ensure};
use nvsprior::Prior;
use nvsprior_basin::PRIOR;
use nvsprior_inputs::args::{DeviceArgs, progress};
use serde_json::Value;

use super::{ReportArgs, plot};
use tiled::Tiled;

/// Measure priors in blocks: sites of 100,000, a million and ten million splats, which are rows of copies of one scene
///
/// A camera flies along the row and looks to the side. Measures the time of a frame, and the memory of a process that
/// encodes. Then it crosses --parts copies, and compares each packet with that of the prior loaded whole. Writes
/// site.json, flight.json and site.svg.
#[derive(clap::Args)]
pub struct Args {
    /// The scene, of the shape of the demo's [default: the demo's]
    #[arg(long, value_name = "FILE")]
    prior: Option<PathBuf>,
    /// Most memory of the splats
    #[arg(long, value_name = "MIB", default_value_t = 256, value_parser = clap::value_parser!(u32).range(1..))]
    memory: u32,
    /// Copies that the flight crosses
    #[arg(long, value_name = "N", default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..=200))]
    parts: u32,
    /// What a process that this command starts measures
    #[arg(long, value_name = "FILE", hide = true)]
    blocked: Option<PathBuf>,
    /// It crosses the site, and compares with the whole prior
    #[arg(long, hide = true, requires = "blocked")]
    flight: bool,
    #[command(flatten)]
    report: ReportArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

/// Splats of the sites.
const SPLATS: [usize; 3] = [100_000, 1_000_000, 10_000_000];

/// Measures, prints and writes it all to a folder.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let (folder, device) = (args.report.folder()?, &args.device);
    let limit = u64::from(args.memory) << 20;
    if let Some(blocked) = &args.blocked {
        let engine = device.open()?;
        let value = match args.flight {
            true => flight::fly(&engine, blocked, limit)?,
            false => measured::measure(&engine, blocked, limit)?,
        };
        std::fs::write(outcome_of(blocked), value.to_string())?;
        return device.check(&engine);
    }
    let tiled = Tiled::of(&match &args.prior {
        Some(file) => Prior::open(file, &Default::default())?,
        None => Prior::from_bytes(PRIOR, "the demo's prior", &Default::default())?,
    })?;
    let mut rows = Vec::new();
    for splats in SPLATS {
        rows.push(in_a_process(folder, &tiled, splats, false)?);
        println!("{}", line(&rows[rows.len() - 1]));
    }
    std::fs::write(folder.join("site.json"), serde_json::to_string_pretty(&rows)?)?;
    plot::site(&folder.join("site.svg"), &rows)?;
    let growth = ["frame_ms", "host_bytes", "device_bytes"].map(|name| {
        let of = |row: &Value| row[name].as_f64().unwrap_or(f64::NAN);
        format!("{name} × {:.2}", of(&rows[2]) / of(&rows[1]))
    });
    println!("from a million splats to ten million: {}", growth.join(", "));
    let parts = args.parts as usize;
    let flight = in_a_process(folder, &tiled, parts * tiled.part(), true)?;
    std::fs::write(folder.join("flight.json"), serde_json::to_string_pretty(&flight)?)?;
    println!("flight across {parts} copies: {flight:#}");
    Ok(())
}

/// The file that a process leaves its outcome in.
fn outcome_of(blocked: &Path) -> PathBuf {
    blocked.with_extension("json")
}

/// Writes a site, and has a process of its own measure it: so its memory is known.
fn in_a_process(
    folder: &Path,
    tiled: &Tiled,
    splats: usize,
    flight: bool,
) -> anyhow::Result<Value> {
    let name = if flight { "flight-site.nvsb".into() } else { format!("site-{splats}.nvsb") };
    let blocked = folder.join(name);
    let bar = progress(splats, "splats written");
    tiled.write(&blocked, splats, &mut |done| bar.set_position(done as u64))?;
    bar.finish_and_clear();
    let mut command = Command::new(std::env::current_exe()?);
    // The arguments of this process, and what it is to measure.
    command.args(std::env::args_os().skip(1)).arg("--blocked").arg(&blocked);
    command.args(flight.then_some("--flight"));
    let status = command.status().context("starting a process to measure in")?;
    ensure!(status.success(), "measuring {} failed: {status}", blocked.display());
    let outcome = outcome_of(&blocked);
    let value = serde_json::from_slice(&std::fs::read(&outcome)?)?;
    std::fs::remove_file(outcome)?;
    std::fs::remove_file(blocked)?;
    Ok(value)
}

fn line(row: &Value) -> String {
    let mebibytes = |name: &str| row[name].as_f64().unwrap_or(f64::NAN) / f64::from(1 << 20);
    format!(
        "{} splats: {:.1} ms a frame, {:.0} MiB of host memory, {:.0} MiB of the device's; {} splats on the device",
        row["splats"],
        row["frame_ms"].as_f64().unwrap_or(f64::NAN),
        mebibytes("host_bytes"),
        mebibytes("device_bytes"),
        row["splats_on_device"],
    )
}
