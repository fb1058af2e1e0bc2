//! `nvsprior decode`: packets in, pictures out.

use std::path::{Path, PathBuf};

use anyhow::Context;
use nvsprior::packet::PacketError;
use nvsprior::render::Scene;
use nvsprior::{Decoded, Decoder, Error, Trust};

use nvsprior_inputs::args::{DeviceArgs, PriorArgs, SizeArgs, progress};
use nvsprior_inputs::camera_file::CameraFile;
use nvsprior_inputs::{frame_file, values};

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
    /// The packets come from `nvsprior join`: of those that are not complete, show what came
    #[arg(long)]
    joined: bool,
    /// Folder with updates of the prior, NAME.nvsu, as `encode --learn` writes them; each is taken after packet
    /// NAME.nvsp [default: the packets' folder]
    #[arg(long, value_name = "DIR")]
    updates: Option<PathBuf>,
    /// Cameras that may have been sent in packets that did not arrive
    #[arg(long, value_name = "FILE")]
    cameras: Option<PathBuf>,
    /// Those cameras' frames were reduced to this width by `encode` [default: 320]
    #[arg(long, value_name = "PIXELS", requires = "cameras")]
    width: Option<u32>,
    #[command(flatten)]
    device: DeviceArgs,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let packets = values::files(&args.packets, "nvsp", "packets")?;
    values::make_folder("--frames", &args.frames)?;
    let engine = args.device.open()?;
    let updates = Updates::of(args, &packets);
    let scene = match updates.is_empty() {
        true => args.prior.upload(&engine)?,
        false => engine.upload_for_updates(&args.prior.open()?)?,
    };
    let mut decoder = Decoder::new(&engine, &scene);
    if let Some(path) = &args.cameras {
        let size = args.width.map_or_else(SizeArgs::default, SizeArgs::of);
        for view in &CameraFile::open(path)?.views {
            let camera = size.reduced(&view.camera);
            decoder
                .add_camera(&camera)
                .with_context(|| format!("{}: {}", path.display(), view.name))?;
        }
    }
    let bar = progress(packets.len(), "decoding");
    let (mut failed, mut foreign, mut other, mut missing) = (0, 0, 0, 0);
    for path in &packets {
        match decode(&mut decoder, path, args) {
            Ok(decoded) => {
                other += usize::from(decoded.same_render == Some(false));
                missing += usize::from(decoded.missing_update.is_some());
            }
            Err(error) => {
                if failed < NAMED {
                    bar.suspend(|| eprintln!("{}: {error:#}", path.display()));
                }
                failed += 1;
                foreign += usize::from(is_foreign(&error));
            }
        }
        if let Err(error) = updates.take(&mut decoder, path) {
            bar.suspend(|| eprintln!("{error:#}"));
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    if failed > NAMED {
        eprintln!("and {} more", failed - NAMED);
    }
    if foreign > 0 {
        eprintln!("{}", if_foreign(&scene));
    }
    println!("{} of {} packets decoded", packets.len() - failed, packets.len());
    if other > 0 {
        println!("{other} renders are not the vehicle's: its device or driver rounds differently");
    }
    if missing > 0 {
        println!(
            "{missing} pictures are renders without an update that the vehicle drew them with"
        );
    }
    args.device.check(&engine)?;
    anyhow::ensure!(failed == 0, "{failed} of {} packets could not be decoded", packets.len());
    Ok(())
}

/// The updates of a run: their folder, and the names that are there.
struct Updates(Vec<PathBuf>);

impl Updates {
    /// Those beside the packets, or in the folder that was given.
    fn of(args: &Args, packets: &[PathBuf]) -> Updates {
        let folder = args.updates.as_ref().unwrap_or(&args.packets);
        let path = |packet: &PathBuf| {
            let name = packet.with_extension("nvsu").file_name().map(|name| folder.join(name));
            name.filter(|path| path.exists())
        };
        Updates(packets.iter().filter_map(path).collect())
    }

    fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Gives the decoder the update that was sent after a packet, if there is one.
    fn take(&self, decoder: &mut Decoder, packet: &Path) -> anyhow::Result<()> {
        let stem = packet.file_stem();
        let Some(path) = self.0.iter().find(|path| path.file_stem() == stem) else { return Ok(()) };
        let named = || path.display().to_string();
        let bytes = std::fs::read(path).with_context(named)?;
        decoder.add_update(&bytes).with_context(named)?;
        Ok(())
    }
}

/// Packets that are named if they cannot be decoded.
const NAMED: usize = 5;

/// Whether a packet seems to be about another prior.
fn is_foreign(error: &anyhow::Error) -> bool {
    let prior = |error: &PacketError| matches!(error, PacketError::Prior { .. });
    match error.downcast_ref() {
        Some(Error::SessionUnknown { .. }) => true,
        Some(Error::Packet(error)) => prior(error),
        _ => false,
    }
}

/// What to look at then.
fn if_foreign(scene: &Scene) -> String {
    format!(
        "the prior at hand is {}. It must be the file that `encode` had. Render options are part of a prior's \
            identity: \
         --near, --alpha-max and --antialiased must be as with `encode`",
        scene.id()
    )
}

fn decode(decoder: &mut Decoder, path: &Path, args: &Args) -> anyhow::Result<Decoded> {
    let trust = if args.joined { Trust::Start } else { Trust::Whole };
    let mut decoded = Decoded::default();
    decoder.decode_into(&std::fs::read(path)?, trust, &mut decoded)?;
    if let Some(damage) = &decoded.damage {
        eprintln!("{}: {damage}; the render alone is written", path.display());
    }
    let name = path.with_extension("png");
    let name = name.file_name().context("a packet without a name")?;
    frame_file::write_png(&args.frames.join(name), &decoded.picture)?;
    Ok(decoded)
}
