//! `nvsprior decode`: packets in, pictures out.

use std::path::{Path, PathBuf};

use anyhow::Context;
use nvsprior::{Decoded, Decoder};

use nvsprior_inputs::args::{DeviceArgs, PriorArgs, SizeArgs, progress};
use nvsprior_inputs::camera_file::CameraFile;
use nvsprior_inputs::frame_file;

/// Decode packets to pictures, with the prior alone
///
/// Writes NAME.png for every packet NAME.nvsp, in the order of their names. If a packet cannot be
/// decoded, it is named and left out, and the exit code is 1. If its difference picture is damaged,
/// it gives the render alone.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    prior: PriorArgs,
    /// Folder with the packets, NAME.nvsp
    #[arg(long, value_name = "DIR")]
    packets: PathBuf,
    /// Folder for the pictures; made if it is missing
    #[arg(long, value_name = "DIR")]
    frames: PathBuf,
    /// Cameras that may have been sent in packets that did not arrive
    #[arg(long, value_name = "FILE")]
    cameras: Option<PathBuf>,
    #[command(flatten)]
    size: SizeArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let packets = packet_files(&args.packets)?;
    let engine = args.device.open()?;
    let scene = args.prior.upload(&engine)?;
    let mut decoder = Decoder::new(&engine, &scene);
    if let Some(path) = &args.cameras {
        for view in &CameraFile::open(path)?.views {
            let camera = args.size.reduced(&view.camera);
            decoder
                .add_camera(&camera)
                .with_context(|| format!("{}: {}", path.display(), view.name))?;
        }
    }
    std::fs::create_dir_all(&args.frames)
        .with_context(|| format!("making {}", args.frames.display()))?;
    let bar = progress(packets.len(), "decoding");
    let (mut failed, mut other) = (0, 0);
    for path in &packets {
        match decode(&mut decoder, path, &args.frames) {
            Ok(decoded) => other += usize::from(decoded.same_render == Some(false)),
            Err(error) => {
                bar.suspend(|| eprintln!("{}: {error:#}", path.display()));
                failed += 1;
            }
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    println!("{} of {} packets decoded", packets.len() - failed, packets.len());
    if other > 0 {
        println!("{other} renders are not the vehicle's: its device or driver rounds differently");
    }
    args.device.check(&engine)?;
    anyhow::ensure!(failed == 0, "{failed} of {} packets could not be decoded", packets.len());
    Ok(())
}

/// Packets of a folder in the order of their names.
fn packet_files(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let reading = || format!("reading {}", folder.display());
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).with_context(reading)? {
        let path = entry.with_context(reading)?.path();
        if path.extension().is_some_and(|e| e == "nvsp") {
            files.push(path);
        }
    }
    files.sort();
    anyhow::ensure!(!files.is_empty(), "{}: no packets (*.nvsp)", folder.display());
    Ok(files)
}

fn decode(decoder: &mut Decoder, path: &Path, frames: &Path) -> anyhow::Result<Decoded> {
    let decoded = decoder.decode(&std::fs::read(path)?)?;
    if let Some(damage) = &decoded.damage {
        eprintln!("{}: {damage}; the render alone is written", path.display());
    }
    let name = path.with_extension("png");
    let name = name.file_name().context("a packet without a name")?;
    frame_file::write_png(&frames.join(name), &decoded.picture)?;
    Ok(decoded)
}
