//! `nvsprior decode`: packets in, pictures out.

mod doubt;
mod truth;

use std::path::{Path, PathBuf};

use anyhow::Context;
use nvsprior::packet::PacketError;
use nvsprior::render::Scene;
use nvsprior::{Decoded, Decoder, Error, Trust};
use nvsprior_link::keys::Refusal;

use crate::keyed_files::FileReader;
use doubt::DoubtFolder;
use nvsprior_inputs::args::{DeviceArgs, OverwriteArgs, PriorArgs, SizeArgs, progress};
use nvsprior_inputs::camera_file::CameraFile;
use nvsprior_inputs::keys::KeyArgs;
use nvsprior_inputs::track_file::{TrackFile, TrackPoint};
use nvsprior_inputs::values;
use nvsprior_runs::{FrameFolder, FrameKind};
use truth::{TruthArgs, TruthFolders};

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
    /// Folder for the pictures; made if it is missing, refused if it holds pictures
    #[arg(long, alias = "frames", value_name = "DIR")]
    pictures: PathBuf,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    #[command(flatten)]
    truth: TruthArgs,
    /// Folder for what is known of each picture if it is memory, NAME.png: grey, a pixel for a block of 16×16. 0: the
    /// prior is sure of it; 1: it is doubtful; 2: it was never mapped. Read from the prior
    #[arg(long, value_name = "DIR")]
    doubt: Option<PathBuf>,
    /// Track to write (CSV): the pose of each picture, with within how much the vehicle says that it is known: columns
    /// `known` (the prior's unit) and `known_angle` (degrees), empty if it is not
    #[arg(long, value_name = "FILE", value_parser = values::csv)]
    track: Option<PathBuf>,
    /// Filter the pictures by a small network, with the prior's weights (`nvsprior prior filter`), or with the
    /// library's. They look more like what the camera saw, if the network knows the scene
    #[arg(long)]
    filter: bool,
    /// The packets come from `nvsprior join`: of those that are not complete, show what came
    #[arg(long)]
    joined: bool,
    /// Cameras that may have been sent in packets that did not arrive
    #[arg(long, value_name = "FILE")]
    cameras: Option<PathBuf>,
    /// Those cameras' frames were reduced to this width by `encode` [default: 320]
    #[arg(long, value_name = "PIXELS", requires = "cameras")]
    width: Option<u32>,
    #[command(flatten)]
    key: KeyArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let keys = args.key.open()?;
    let packets = values::files(&args.packets, "nvsp", "packets")?;
    let mut outputs = Outputs::open(args)?;
    if let Some(file) = &args.track {
        values::check_file("--track", file)?;
    }
    let engine = args.device.open()?;
    let scene = args.prior.upload(&engine)?;
    let mut reader = FileReader::new(keys.as_ref());
    let mut decoder = Decoder::new(&engine, &scene);
    decoder.set_filter(args.filter)?;
    if let Some(path) = &args.cameras {
        let size = args.width.map_or_else(SizeArgs::default, SizeArgs::of);
        for view in &CameraFile::open(path)?.views {
            let camera = size.reduced(&view.camera);
            decoder
                .add_camera(&camera)
                .with_context(|| format!("{}: {}", path.display(), view.name))?;
        }
    }
    if let Some(folder) = &args.doubt {
        let folder = args.overwrite.open("--doubt", folder, FrameKind::DOUBT)?;
        outputs.doubt = Some(DoubtFolder::new(folder, &engine, &args.prior)?);
    }
    let mut track = args.track.as_deref().map(TrackFile::of_packets).transpose()?;
    let bar = progress(packets.len(), "decoding");
    let (mut failed, mut foreign, mut other, mut filtered) = (0, 0, 0, 0);
    let mut strange = 0;
    for path in &packets {
        let read = reader.read(path);
        let decoded = read.and_then(|packet| outputs.decode(&mut decoder, (path, &packet), args));
        match decoded {
            Ok(decoded) => {
                if let Some(track) = &mut track {
                    let name = path.file_stem().unwrap_or_default().to_string_lossy();
                    track.write(&name, None, &decoded.pose, TrackPoint::Known(decoded.known))?;
                }
                other += usize::from(decoded.same_render == Some(false));
                filtered += usize::from(decoded.filtered);
            }
            Err(error) => {
                if failed < NAMED {
                    bar.suspend(|| tell!("{}: {error:#}", path.display()));
                }
                failed += 1;
                foreign += usize::from(is_foreign(&error));
                strange += usize::from(error.is::<Refusal>());
            }
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    outputs.finish()?;
    if failed > NAMED {
        tell!("and {} more", failed - NAMED);
    }
    if foreign > 0 {
        tell!("{}", if_foreign(&scene));
    }
    if strange > 0 {
        tell!(
            "{strange} packets were refused by their tags: --key, --epoch and --tag must be as with `encode`"
        );
    }
    say!("{} of {} packets decoded", packets.len() - failed, packets.len());
    if args.filter {
        let whose = if scene.filter_weights().is_some() { "the scene's" } else { "the library's" };
        say!("{filtered} pictures filtered, with {whose} weights");
    }
    if other > 0 {
        say!("{other} renders are not the vehicle's: its device or driver rounds differently");
    }
    args.device.check(&engine)?;
    anyhow::ensure!(failed == 0, "{failed} of {} packets could not be decoded", packets.len());
    Ok(())
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

/// The folders that are written to.
struct Outputs {
    pictures: FrameFolder,
    truth: TruthFolders,
    doubt: Option<DoubtFolder>,
}

impl Outputs {
    fn open(args: &Args) -> anyhow::Result<Outputs> {
        let kind = FrameKind::RECONSTRUCTION;
        let pictures = args.overwrite.open("--pictures", &args.pictures, kind)?;
        Ok(Outputs { pictures, truth: args.truth.open(&args.overwrite)?, doubt: None })
    }

    /// Decodes a packet, and writes what is asked for.
    fn decode(
        &mut self,
        decoder: &mut Decoder,
        (path, packet): (&Path, &[u8]),
        args: &Args,
    ) -> anyhow::Result<Decoded> {
        let trust = if args.joined { Trust::Start } else { Trust::Whole };
        let mut decoded = Decoded::default();
        decoder.decode_into(packet, trust, &mut decoded)?;
        if let Some(damage) = &decoded.damage {
            tell!("{}: {damage}; the render alone is written", path.display());
        }
        let name = path.file_stem().context("a packet without a name")?.to_string_lossy();
        self.pictures.write_picture(&name, &decoded.picture)?;
        self.truth.write(&name, &decoded.picture, &decoded.truth)?;
        if let Some(doubt) = &mut self.doubt {
            doubt.write(&name, decoder, &decoded.pose)?;
        }
        Ok(decoded)
    }

    fn finish(&mut self) -> anyhow::Result<()> {
        self.pictures.finish()?;
        self.truth.finish()?;
        self.doubt.iter_mut().try_for_each(DoubtFolder::finish)
    }
}
