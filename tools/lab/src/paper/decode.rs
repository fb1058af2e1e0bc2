//! `nvsprior-lab paper decode`.

use std::path::PathBuf;

use anyhow::Context as _;
use nvsprior::Picture;
use nvsprior_inputs::args::{DeviceArgs, OverwriteArgs, PriorArgs, progress};
use nvsprior_inputs::values;
use nvsprior_paper::Decoder;
use nvsprior_runs::FrameKind;

use super::encode::ENDING;
use crate::args::check_origin;

/// Decode what `paper encode` wrote
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    prior: PriorArgs,
    /// Folder with the packets, NAME.paper
    #[arg(long, value_name = "DIR")]
    packets: PathBuf,
    /// Folder for the pictures (NAME.png); made if it is missing
    #[arg(long, alias = "frames", value_name = "DIR")]
    pictures: PathBuf,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let packets = values::files(&args.packets, ENDING, "packets")?;
    let kind = FrameKind::RECONSTRUCTION;
    let mut pictures = args.overwrite.open("--pictures", &args.pictures, kind)?;
    let engine = args.device.open()?;
    let scene = args.prior.upload(&engine)?;
    check_origin(&scene)?;
    let (mut decoder, mut picture) = (Decoder::new(&engine, &scene), Picture::default());
    let bar = progress(packets.len(), "decoding");
    for path in &packets {
        let packet = std::fs::read(path).with_context(|| path.display().to_string())?;
        decoder.decode(&packet, &mut picture).with_context(|| path.display().to_string())?;
        let name = path.file_stem().context("a packet without a name")?;
        pictures.write_picture(&name.to_string_lossy(), &picture)?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    pictures.finish()?;
    println!("{} packets decoded", packets.len());
    args.device.check(&engine)
}
