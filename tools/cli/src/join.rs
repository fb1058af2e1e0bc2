//! `nvsprior join`: modem frames to packets.

mod mtu;
mod runs;

use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::Context;
use nvsprior_inputs::args::OverwriteArgs;
use nvsprior_inputs::values;
use nvsprior_link::modem::MIN_MTU;

use runs::{Run, Runs};

/// Put packets together from the frames of a modem
///
/// Takes frames as `nvsprior split` makes them, in the order of their files' names, or as they come over UDP. Frames
/// may be missing, repeated, swapped or padded. Writes NUMBER.nvsp for every frame number: the whole packet, or as much
/// of it as has come without a gap, of which `nvsprior decode --joined` makes the best possible picture. If another
/// packet comes with a number that was there before, the vehicle has counted anew: a new run begins, in the folder 2,
/// 3, … within --out.
#[derive(clap::Args)]
pub struct Args {
    /// Folder with the frames, *.frame
    #[arg(value_name = "DIR", required_unless_present = "udp", conflicts_with = "udp")]
    frames: Option<PathBuf>,
    /// Receive frames at this address, such as 0.0.0.0:5600
    #[arg(long, value_name = "ADDRESS", requires = "mtu")]
    udp: Option<String>,
    /// The MTU that the packets were split for [default: the length of the longest frame]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(MIN_MTU as i64..))]
    mtu: Option<u16>,
    /// End if no frame came for so many seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 10, requires = "udp",
        value_parser = clap::value_parser!(u32).range(1..=86_400))]
    idle: u32,
    /// Folder for the packets; made if it is missing, refused if it holds packets
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    overwrite: OverwriteArgs,
}

/// Frames that came, put together.
struct Joined {
    runs: Vec<Run>,
    refused: usize,
    /// Why nothing may have come together.
    hint: Option<String>,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let joined = match (&args.frames, &args.udp) {
        (Some(folder), _) => from_folder(args, folder)?,
        (None, address) => from_udp(args, address.as_deref().unwrap_or_default())?,
    };
    let Joined { runs, refused, hint } = &joined;
    let packets: usize = runs.iter().map(|run| run.packets.len()).sum();
    let complete: usize = runs.iter().map(Run::complete).sum();
    say!("{packets} packets, {complete} of them complete; {refused} frames were refused");
    if runs.len() > 1 {
        say!("frame numbers have begun anew:");
        for run in runs {
            let (all, complete) = (run.packets.len(), run.complete());
            say!("  {}: {all} packets, {complete} of them complete", run.folder.display());
        }
    }
    if let Some(hint) = hint {
        tell!("{hint}");
    }
    anyhow::ensure!(packets > 0, "no packet: no first frame of one has come");
    anyhow::ensure!(complete > 0, "no packet is complete");
    Ok(())
}

fn from_folder(args: &Args, folder: &Path) -> anyhow::Result<Joined> {
    let mut frames = Vec::new();
    for path in values::files(folder, "frame", "frames")? {
        let bytes = std::fs::read(&path).with_context(|| format!("reading {}", path.display()))?;
        frames.push(bytes);
    }
    let longest = frames.iter().map(Vec::len).max().unwrap_or(0);
    let mtu = args.mtu.map_or(longest.max(MIN_MTU), usize::from);
    let mut runs = Runs::new(mtu, &args.out, args.overwrite.overwrite)?;
    frames.iter().try_for_each(|frame| runs.push(frame))?;
    let refused = runs.refused();
    let runs = runs.finish()?;
    let is_whole = refused == 0 && runs.iter().all(|run| run.complete() == run.packets.len());
    let hint = if is_whole { None } else { mtu::other(&frames, mtu) };
    Ok(Joined { runs, refused, hint })
}

fn from_udp(args: &Args, address: &str) -> anyhow::Result<Joined> {
    /// Between two looks at whether the program is to stop.
    const LOOK: Duration = Duration::from_millis(200);
    let mtu = args.mtu.map_or(MIN_MTU, usize::from);
    let mut runs = Runs::new(mtu, &args.out, args.overwrite.overwrite)?;
    let socket = UdpSocket::bind(address).with_context(|| format!("--udp {address}"))?;
    socket.set_read_timeout(Some(LOOK))?;
    let stopped = Arc::new(AtomicBool::new(false));
    let stop = stopped.clone();
    ctrlc::set_handler(move || stop.store(true, Ordering::Relaxed))?;
    tell!("waiting for frames at {}", socket.local_addr()?);
    let (mut last, idle) = (Instant::now(), Duration::from_secs(args.idle.into()));
    let (mut frame, mut longest) = (vec![0; 1 << 16], 0);
    while last.elapsed() < idle && !stopped.load(Ordering::Relaxed) {
        match socket.recv(&mut frame) {
            Ok(length) => {
                longest = longest.max(length);
                last = Instant::now();
                runs.push(&frame[..length])?;
            }
            Err(error) if is_timeout(&error) => {}
            Err(error) => return Err(error).with_context(|| format!("--udp {address}")),
        }
    }
    let refused = runs.refused();
    let runs = runs.finish()?;
    let none = longest > 0 && runs.iter().all(|run| run.complete() == 0);
    let hint = none.then(|| {
        format!(
            "the longest frame that came has {longest} bytes; --mtu {mtu} must be as with `split`"
        )
    });
    Ok(Joined { runs, refused, hint })
}

fn is_timeout(error: &std::io::Error) -> bool {
    use std::io::ErrorKind::{Interrupted, TimedOut, WouldBlock};
    matches!(error.kind(), TimedOut | WouldBlock | Interrupted)
}
