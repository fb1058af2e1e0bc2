//! `nvsprior-lab device-report`: all that is measured of a device, on the demo's scene.

use std::path::PathBuf;
use std::process::ExitCode;

use nvsprior::{Camera, Prior};
use nvsprior_basin::{CAMERA, Conditions, DemoFrame, Run};
use nvsprior_inputs::args::DeviceArgs;
use nvsprior_inputs::values;

use super::devices;
use super::measuring::Subject;
use super::schema::Bounds;

/// Measure a device within minutes: one report, one page
///
/// Compares the device's pictures with the host's, as `nvsprior devices --check` does. Then measures the device's
/// ceilings and, on the demo's scene at 320×180 and 640×360, its time by stage beside ceilings and prediction, the
/// search, the coding for 300 and 1000 bytes, and memory. Writes report.json and index.html, and prints them. What
/// cannot be measured is named. With --table it measures nothing: it prints the table of docs/latency.md from such
/// reports.
///
/// Exit codes: 0 all measured and the device is portable, 1 not portable or something failed, 2 wrong usage. The report
/// is written in the first two cases.
#[derive(clap::Args)]
pub struct Args {
    /// Folder for report.json and index.html; made if it is missing
    #[arg(long, value_name = "DIR", default_value = "device-report")]
    out: PathBuf,
    #[command(flatten)]
    bounds: Bounds,
    #[command(flatten)]
    device: DeviceArgs,
    /// Reports to make the table of docs/latency.md from, a row for each
    #[arg(long, value_name = "JSON", num_args = 1.., conflicts_with_all = ["out", "device"])]
    table: Vec<PathBuf>,
    /// Writes the table into this document
    #[arg(long, value_name = "FILE", requires = "table")]
    into: Option<PathBuf>,
}

/// Sizes that are measured; the camera is the demo's.
const SIZES: [[u32; 2]; 2] = [[320, 180], [640, 360]];
/// Bytes of packets.
const BUDGETS: [usize; 2] = [300, 1000];

/// Measures, writes, prints; the exit code says whether the device is portable and all was measured.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    if !args.table.is_empty() {
        return table(args);
    }
    values::make_folder("--out", &args.out)?;
    let prior = Prior::from_bytes(nvsprior_basin::PRIOR, "the demo's prior", &Default::default())?;
    let frames = |camera: Camera| -> Box<dyn Iterator<Item = DemoFrame>> {
        Box::new(nvsprior_basin::inspection_run_by(camera, Run::T2, usize::MAX, Conditions::CALM))
    };
    let cameras = SIZES.map(|[width, height]| CAMERA.resized(width, height));
    let subject = Subject { prior: &prior, cameras: &cameras, frames: &frames, budgets: &BUDGETS };
    let report = super::measure(&args.device, &subject, args.bounds);
    super::write(&report, &args.out)?;
    Ok(if report.passed() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn table(args: &Args) -> anyhow::Result<ExitCode> {
    let section = devices::section(&args.table)?;
    match &args.into {
        Some(document) => devices::renew(document, &section)?,
        None => print!("{section}"),
    }
    Ok(ExitCode::SUCCESS)
}
