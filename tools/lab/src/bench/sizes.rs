//! `nvsprior-lab sizes`: bytes, times and memory by the size of the pictures.

mod coder;

use std::path::Path;

use anyhow::ensure;
use nvsprior::image::Preprocessor;
use nvsprior::render::Scene;
use nvsprior::residual::ResidualSetup;
use nvsprior::{Camera, Decoder, Encoder, EncoderOptions, Engine, FrameStats, Rate};
use nvsprior_inputs::args::{DeviceArgs, PriorArgs, progress};
use nvsprior_inputs::input::InputArgs;
use serde::Serialize;

use super::context::{Shot, host_bytes};
use super::forward::{Forward, timed};
use super::{ReportArgs, plot};
use crate::args::check_origin;
use nvsprior_inputs::report::{Table, fixed, fixed_or_empty, write_json};
use nvsprior_inputs::statistics::median;

/// Measure sizes of pictures: bytes at 31, 32 and 33 dB, times and memory at each width
///
/// Also the wavelet coder's CPU time by rate. Writes sizes.json, sizes.csv, coder.csv, bytes.svg, times.svg and
/// psnr.svg.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    prior: PriorArgs,
    #[command(flatten)]
    input: InputArgs,
    /// The widths. Those wider than the frames are left out
    #[arg(long, value_name = "PIXELS,...", value_delimiter = ',', default_values_t = [160, 320, 640, 1280],
        value_parser = clap::value_parser!(u32).range(1..=i64::from(Camera::MAX_SIDE)))]
    widths: Vec<u32>,
    #[command(flatten)]
    report: ReportArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

/// The qualities that bytes are measured at, dB.
const TARGETS: [f64; 3] = [31.0, 32.0, 33.0];

/// What coding to a PSNR took.
#[derive(Serialize)]
struct AtPsnr {
    target_db: f64,
    /// Means over the frames.
    bytes: f64,
    psnr_db: f64,
    /// Frames that reached the target.
    reached: usize,
    code_ms: f64,
    decode_ms: f64,
}

/// A size. Times are medians over the frames, without the first one.
#[derive(Serialize)]
struct Row {
    width: u32,
    height: u32,
    frames: usize,
    certain: usize,
    /// Mean of the renders at the poses that were found.
    render_psnr_db: f64,
    /// Evaluations of the full picture and final pictures, a mean.
    full_renders: f64,
    /// From the frame to pose, render and difference.
    search_ms: f64,
    /// CPU time of the program for that, a mean; the device's too, if it is the CPU.
    search_cpu_ms: Option<f64>,
    /// A forward render.
    render_ms: f64,
    at_psnr: Vec<AtPsnr>,
    /// Most host memory of the program up to here: all sizes so far, frames and prior included.
    host_bytes: Option<u64>,
    /// Of an encoder and a decoder, and the prior.
    device_bytes: u64,
    /// The coder alone, on the renders at the poses that were found.
    coder: Vec<coder::AtRate>,
}

/// Measures, prints and writes it all to a folder.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let (folder, input) = (args.report.folder()?, &args.input);
    let prior = args.prior.open()?;
    let inputs = input.at_width(0).frames()?;
    let widest = inputs.iter().map(|input| input.camera.width).min().unwrap_or(0);
    let mut widths = args.widths.clone();
    widths.sort_unstable();
    widths.retain(|width| *width <= widest);
    ensure!(!widths.is_empty(), "--widths: the frames are only {widest} pixels wide");
    ensure!(inputs.len() > 1, "one frame is no run, as the first one does not count");
    let engine = args.device.open()?;
    let scene = engine.upload(&prior)?;
    check_origin(&scene)?;
    let mut preprocessor = Preprocessor::new(prior.preprocessing());
    let mut rows = Vec::new();
    for width in widths {
        let inputs = input.at_width(width).frames()?;
        let shots = inputs.iter().map(|input| Shot::read(input, &mut preprocessor));
        let shots = shots.collect::<anyhow::Result<Vec<_>>>()?;
        rows.push(Size { engine: &engine, scene: &scene, shots: &shots }.measure()?);
    }
    let table = table(&rows);
    table.print();
    table.write_csv(&folder.join("sizes.csv"))?;
    let coder = coder::table(rows.iter().flat_map(|row| &row.coder));
    coder.print();
    coder.write_csv(&folder.join("coder.csv"))?;
    write_json(&folder.join("sizes.json"), &rows)?;
    plots(&rows, folder)?;
    args.device.check(&engine)
}

/// A size under way.
struct Size<'a> {
    engine: &'a Engine,
    scene: &'a std::sync::Arc<Scene>,
    shots: &'a [Shot],
}

/// Frames in a row, encoded.
struct Run {
    packets: Vec<Vec<u8>>,
    stats: Vec<FrameStats>,
    poses: Vec<nvsprior::Pose>,
    renders: Vec<nvsprior::Picture>,
    cpu_ms: Option<f64>,
    device_bytes: u64,
}

impl Run {
    fn mean(&self, of: impl Fn(&FrameStats) -> f64) -> f64 {
        self.stats.iter().map(of).sum::<f64>() / self.stats.len() as f64
    }

    /// Without the first frame, which is searched from further off.
    fn median(&self, of: impl Fn(&FrameStats) -> f64) -> f64 {
        median(self.stats[1..].iter().map(of))
    }
}

impl Size<'_> {
    fn measure(&self) -> anyhow::Result<Row> {
        let camera = self.shots[0].camera;
        let searched = self.encode(None)?;
        let mut forward = Forward::new(self.engine, self.scene);
        for pose in &searched.poses {
            forward.measure(&camera, pose)?;
        }
        let mut device_bytes = searched.device_bytes;
        let mut at_psnr = Vec::new();
        for target_db in TARGETS {
            let run = self.encode(Some(Rate::Psnr(target_db)))?;
            let (decode_ms, used) = self.decode(&run.packets)?;
            device_bytes = device_bytes.max(run.device_bytes).max(used);
            at_psnr.push(AtPsnr {
                target_db,
                bytes: run.mean(|stats| stats.bytes as f64),
                psnr_db: run.mean(|stats| stats.psnr),
                reached: run.stats.iter().filter(|stats| stats.rate_kept).count(),
                code_ms: run.median(|stats| stats.code_milliseconds),
                decode_ms,
            });
        }
        let pictures = self.shots.iter().map(|shot| &shot.picture);
        let pairs: Vec<_> = pictures.zip(&searched.renders).collect();
        Ok(Row {
            coder: coder::measure(&self.coder_setup(&camera), &pairs)?,
            width: camera.width,
            height: camera.height,
            frames: self.shots.len(),
            certain: searched.stats.iter().filter(|stats| stats.certain).count(),
            render_psnr_db: searched.mean(|stats| stats.render_psnr),
            full_renders: searched.mean(|stats| stats.full_renders.into()),
            search_ms: searched.median(|stats| stats.refine_milliseconds),
            search_cpu_ms: searched.cpu_ms,
            render_ms: median(forward.times.iter().copied()),
            at_psnr,
            host_bytes: host_bytes(),
            device_bytes,
        })
    }

    fn coder_setup(&self, camera: &Camera) -> ResidualSetup {
        let tables = self.scene.coder_tables().clone();
        let portable = self.engine.device().portable;
        let setup = ResidualSetup::new(camera.width, camera.height);
        ResidualSetup { tables, portable, ..setup }
    }

    fn encode(&self, rate: Option<Rate>) -> anyhow::Result<Run> {
        let options = EncoderOptions { rate, frames_treated: true, ..EncoderOptions::default() };
        let mut encoder = Encoder::new(self.engine, self.scene, &self.shots[0].camera, options)?;
        let (mut packets, mut stats) = (Vec::new(), Vec::new());
        let (mut poses, mut renders) = (Vec::new(), Vec::new());
        let bar = progress(self.shots.len(), "encoding");
        let mut begun = None;
        for shot in self.shots {
            encoder.set_camera(&shot.camera)?;
            let encoded = encoder.encode(&shot.picture, shot.told(shot.external))?;
            packets.push(encoded.packet);
            stats.push(encoded.stats);
            poses.push(encoded.pose);
            renders.push(encoded.render);
            begun = begun.or_else(cpu_ms);
            bar.inc(1);
        }
        let frames = self.shots.len().saturating_sub(1).max(1) as f64;
        let cpu_ms = cpu_ms().zip(begun).map(|(end, begun)| (end - begun) / frames);
        let device_bytes = self.engine.memory().used;
        Ok(Run { packets, stats, poses, renders, cpu_ms, device_bytes })
    }

    /// Median of the packets' times, milliseconds, without the first one, and the device's memory.
    fn decode(&self, packets: &[Vec<u8>]) -> anyhow::Result<(f64, u64)> {
        let mut decoder = Decoder::new(self.engine, self.scene);
        let mut times = Vec::new();
        for packet in packets {
            times.push(timed(|| Ok(_ = decoder.decode(packet)?))?.1);
        }
        Ok((median(times[1..].iter().copied()), self.engine.memory().used))
    }
}

/// CPU time of this program, all threads, milliseconds; `None` if the system does not say so.
fn cpu_ms() -> Option<f64> {
    /// Linux counts in hundredths of a second here.
    const TICK: f64 = 10.0;
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The program's name, in brackets, may have blanks. Behind it: the state, then numbers; user and system time last.
    let mut fields = stat.rsplit_once(')')?.1.split_whitespace().skip(11);
    let mut ticks = || fields.next()?.parse::<f64>().ok();
    Some(TICK * (ticks()? + ticks()?))
}

fn table(rows: &[Row]) -> Table {
    let mut header = vec!["size".to_owned(), "certain".into(), "render, dB".into()];
    header.extend(TARGETS.map(|target| format!("bytes at {target} dB")));
    let times = ["search, ms", "its CPU, ms", "render, ms", "code, ms", "decode, ms"];
    header.extend(times.map(str::to_owned));
    header.extend(["host, MB", "device, MB"].map(str::to_owned));
    let mut table = Table::new(header);
    for row in rows {
        let middle = &row.at_psnr[TARGETS.len() / 2];
        let mut cells = vec![
            format!("{}×{}", row.width, row.height),
            format!("{} of {}", row.certain, row.frames),
            fixed(row.render_psnr_db, 2),
        ];
        cells.extend(row.at_psnr.iter().map(|at| fixed(at.bytes, 0)));
        cells.push(fixed(row.search_ms, 1));
        cells.push(fixed_or_empty(row.search_cpu_ms, 1));
        cells.extend([row.render_ms, middle.code_ms, middle.decode_ms].map(|ms| fixed(ms, 1)));
        cells.push(fixed_or_empty(row.host_bytes.map(|bytes| bytes as f64 / 1e6), 0));
        cells.push(fixed(row.device_bytes as f64 / 1e6, 0));
        table.push(cells);
    }
    table
}

fn plots(rows: &[Row], folder: &Path) -> anyhow::Result<()> {
    let by_width = |of: &dyn Fn(&Row) -> f64| -> Vec<(f64, f64)> {
        rows.iter().map(|row| (f64::from(row.width), of(row))).collect()
    };
    let middle = TARGETS.len() / 2;
    let bytes = (0..TARGETS.len())
        .map(|at| (format!("{} dB", TARGETS[at]), by_width(&|row| row.at_psnr[at].bytes)));
    plot::sizes(&folder.join("bytes.svg"), "Bytes of a packet at equal PSNR", "bytes", bytes)?;
    let times = [
        ("search".to_owned(), by_width(&|row| row.search_ms)),
        ("forward render".to_owned(), by_width(&|row| row.render_ms)),
        (format!("code, {} dB", TARGETS[middle]), by_width(&|row| row.at_psnr[middle].code_ms)),
        (format!("decode, {} dB", TARGETS[middle]), by_width(&|row| row.at_psnr[middle].decode_ms)),
    ];
    let caption = "Time of a frame, medians";
    plot::sizes(&folder.join("times.svg"), caption, "milliseconds", times.into_iter())?;
    let point = |row: &Row| ((row.search_ms, row.render_psnr_db), format!("{} wide", row.width));
    plot::psnr_by_time(&folder.join("psnr.svg"), rows.iter().map(point).collect())
}
