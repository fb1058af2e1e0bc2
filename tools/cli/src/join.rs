//! `nvsprior join`: modem frames to packets.

use std::collections::BTreeMap;
use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::Context;
use nvsprior::prior::replace_file;
use nvsprior_inputs::values;
use nvsprior_link::modem::{
    Collected, Collector, CollectorOptions, MIN_MTU, ModemError, largest_packet, share_count,
};

/// Put packets together from the frames of a modem
///
/// Takes frames as `nvsprior split` makes them, in the order of their files' names, or as they come over UDP. Frames
/// may be missing, repeated, swapped or padded. Writes NUMBER.nvsp for every frame number: the whole packet, or as much
/// of it as has come without a gap, of which `nvsprior decode --joined` makes the best possible picture.
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
    /// Folder for the packets; made if it is missing
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let joined = match (&args.frames, &args.udp) {
        (Some(folder), _) => from_folder(args, folder)?,
        (None, address) => from_udp(args, address.as_deref().unwrap_or_default())?,
    };
    let Joined { packets, collector, .. } = &joined;
    let complete = packets.values().filter(|(_, complete)| *complete).count();
    say!(
        "{} packets, {complete} of them complete; {} frames were refused",
        packets.len(),
        collector.statistics().rejected
    );
    anyhow::ensure!(!packets.is_empty(), "no packet: no first frame of one has come");
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
    let mut joined = Joined::new(mtu, &args.out)?;
    frames.iter().try_for_each(|frame| joined.push(frame))?;
    Ok(joined)
}

fn from_udp(args: &Args, address: &str) -> anyhow::Result<Joined> {
    let mut joined = Joined::new(args.mtu.map_or(MIN_MTU, usize::from), &args.out)?;
    let socket = UdpSocket::bind(address).with_context(|| format!("--udp {address}"))?;
    socket.set_read_timeout(Some(Duration::from_secs(args.idle.into())))?;
    tell!("waiting for frames at {}", socket.local_addr()?);
    let mut frame = vec![0; 1 << 16];
    loop {
        match socket.recv(&mut frame) {
            Ok(length) => joined.push(&frame[..length])?,
            Err(error) if is_timeout(&error) => return Ok(joined),
            Err(error) => return Err(error).with_context(|| format!("--udp {address}")),
        }
    }
}

fn is_timeout(error: &std::io::Error) -> bool {
    use std::io::ErrorKind::{TimedOut, WouldBlock};
    matches!(error.kind(), TimedOut | WouldBlock)
}

/// Packets that frames were joined to.
struct Joined {
    collector: Collector,
    /// When frames come, seconds.
    now: f64,
    folder: PathBuf,
    /// Bytes written of each frame number, and whether they are all.
    packets: BTreeMap<u32, (usize, bool)>,
}

/// Packets that are held, as many as can be: packets of files may come in any order of their numbers.
const HELD: usize = 64;
/// Seconds after which none of them is held any more.
const APART: f64 = 60.0;
/// The longest packet, bytes.
const MAX_BYTES: usize = 1 << 16;

impl Joined {
    fn new(mtu: usize, folder: &Path) -> anyhow::Result<Joined> {
        let shares = share_count(MAX_BYTES.min(largest_packet(mtu)?), mtu)?;
        let options = CollectorOptions { shares, packets: HELD, ..CollectorOptions::new(mtu) };
        let collector = Collector::new(options)?;
        values::make_folder("--out", folder)?;
        Ok(Joined { collector, now: 0.0, folder: folder.to_path_buf(), packets: BTreeMap::new() })
    }

    /// Takes a frame, and writes each packet that it adds to. What is no frame is counted, and left out.
    fn push(&mut self, frame: &[u8]) -> anyhow::Result<()> {
        let mut pushed = self.collector.push(self.now, frame);
        if matches!(pushed, Err(ModemError::Late(_))) {
            // Another count of numbers.
            self.now += APART;
            pushed = self.collector.push(self.now, frame);
        }
        let Ok(pushed) = pushed else { return Ok(()) };
        let damaged = matches!(pushed, Collected::Damaged(..));
        let newest = self.collector.newest(0).map(|packet| packet.frame);
        let back = |newest: u32| (0..HELD as u32).map(move |k| newest.wrapping_sub(k));
        let held = newest.into_iter().flat_map(back);
        for number in held {
            let Some(packet) = self.collector.packet(0, number) else { continue };
            let known = (packet.bytes.len(), packet.complete);
            if self.packets.get(&packet.frame) == Some(&known) {
                continue;
            }
            let path = self.folder.join(format!("{:08}.nvsp", packet.frame));
            let written = self.packets.get(&packet.frame).is_some_and(|(len, _)| *len > known.0);
            if written && !damaged && std::fs::read(&path)?.starts_with(packet.bytes) {
                // Its start has come again.
                continue;
            }
            replace_file(&path, packet.bytes)?;
            self.packets.insert(packet.frame, known);
        }
        Ok(())
    }
}
