//! `nvsprior-lab paper encode`.

use std::path::PathBuf;

use anyhow::Context as _;
use nvsprior::Rate;
use nvsprior_inputs::args::{DeviceArgs, OverwriteArgs, PriorArgs, progress};
use nvsprior_inputs::input::InputArgs;
use nvsprior_inputs::summary::{self, Row};
use nvsprior_inputs::values::{self, named};
use nvsprior_paper::{DescentOptions, Encoder, EncoderOptions, Optimizer};
use nvsprior_runs::{FrameFolder, FrameKind};

use crate::args::{OPTIMIZERS, check_origin};
use crate::bench::StartArgs;

/// How the names of packets end.
pub const ENDING: &str = "paper";

/// Encode the frames of a camera file as the paper does
///
/// A gradient method searches for each pose, and WebP codes the difference picture.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    prior: PriorArgs,
    #[command(flatten)]
    input: InputArgs,
    #[command(flatten)]
    start: StartArgs,
    #[arg(long, default_value = "bfgs", value_parser = named(&OPTIMIZERS))]
    optimizer: Optimizer,
    /// See `nvsprior encode`
    #[arg(long, value_name = "MSE", default_value_t = 1e-3, value_parser = values::mse, allow_hyphen_values = true)]
    threshold: f64,
    /// Coder of the difference picture
    #[arg(long, default_value = "webp", value_parser = named(&RESIDUALS))]
    residual: IsSent,
    /// Quality of the difference picture, 0 to 100 [default: 10]
    #[arg(long, value_name = "Q", group = "rate", value_parser = values::quality, allow_hyphen_values = true)]
    quality: Option<f32>,
    /// Bytes of the whole packet, never exceeded
    #[arg(long, value_name = "N", group = "rate")]
    bytes: Option<usize>,
    /// PSNR to reach at the least bytes, dB
    #[arg(long, value_name = "DB", group = "rate", value_parser = values::psnr, allow_hyphen_values = true)]
    psnr: Option<f64>,
    /// Folder for the packets, NAME.paper; made if it is missing
    #[arg(long, value_name = "DIR")]
    packets: PathBuf,
    /// Summary to write (JSON), as `nvsprior encode` writes it
    #[arg(long, value_name = "FILE", value_parser = values::json)]
    summary: Option<PathBuf>,
    /// Folder for the reconstructed pictures (PNG)
    #[arg(long, alias = "frames-out", value_name = "DIR")]
    pictures: Option<PathBuf>,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

/// Whether a difference picture is sent. (An option of type `bool` would be a flag.)
type IsSent = bool;
const RESIDUALS: [(&str, IsSent); 2] = [("webp", true), ("none", false)];

impl Args {
    fn options(&self) -> EncoderOptions {
        let rate = match (self.bytes, self.psnr) {
            (Some(bytes), _) => Rate::Bytes(bytes),
            (_, Some(psnr)) => Rate::Psnr(psnr),
            _ => Rate::Quality(self.quality.unwrap_or(10.0)),
        };
        EncoderOptions {
            descent: DescentOptions { optimizer: self.optimizer, ..DescentOptions::default() },
            threshold: self.threshold,
            rate: self.residual.then_some(rate),
            frames_treated: false,
        }
    }
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let mut frames = args.input.frames()?;
    args.start.move_first(&mut frames);
    let kind = FrameKind::Ending(ENDING);
    let mut packets = args.overwrite.open("--packets", &args.packets, kind)?;
    let kind = FrameKind::RECONSTRUCTION;
    let mut pictures = args.overwrite.open_given("--pictures", &args.pictures, kind)?;
    if let Some(file) = &args.summary {
        values::check_file("--summary", file)?;
    }
    let engine = args.device.open()?;
    let scene = args.prior.upload(&engine)?;
    check_origin(&scene)?;
    let mut encoder = Encoder::new(&engine, &scene, &frames[0].camera, args.options())?;
    let bar = progress(frames.len(), "encoding");
    let mut rows = Vec::new();
    for input in frames {
        let encoding = || format!("encoding {}", input.path.display());
        encoder.set_camera(&input.camera).with_context(encoding)?;
        let encoded = encoder.encode(&input.read()?, input.external).with_context(encoding)?;
        packets.write(&format!("{}.{ENDING}", input.name), &encoded.packet)?;
        if let Some(folder) = &mut pictures {
            folder.write_picture(&input.name, &encoded.picture)?;
        }
        let time = input.external.time;
        rows.push(Row { file: input.file, time, pose: encoded.pose, stats: encoded.stats });
        bar.inc(1);
    }
    bar.finish_and_clear();
    summary::print(&rows);
    if let Some(path) = &args.summary {
        summary::write(path, &rows)?;
    }
    packets.finish()?;
    pictures.iter_mut().try_for_each(FrameFolder::finish)?;
    args.device.check(&engine)
}
