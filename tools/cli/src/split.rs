//! `nvsprior split`: packets to modem frames, as files or as datagrams.

use std::io::ErrorKind;
use std::net::{ToSocketAddrs, UdpSocket};
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::Context;
use nvsprior_inputs::args::OverwriteArgs;
use nvsprior_link::modem::{MIN_MTU, Sharer};
use nvsprior_runs::{FrameFolder, FrameKind};

/// Split packets into the frames of a modem
///
/// Writes NAME-0000.frame, NAME-0001.frame, … for every packet NAME.nvsp, or sends each frame as a UDP datagram.
/// `nvsprior join` puts packets together again, from all of the frames or from some.
#[derive(clap::Args)]
pub struct Args {
    /// The packets
    #[arg(value_name = "PACKET", required = true)]
    packets: Vec<PathBuf>,
    /// Most bytes of a modem frame
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(MIN_MTU as i64..))]
    mtu: u16,
    /// Folder for the frames; made if it is missing, refused if it holds frames
    #[arg(long, value_name = "DIR", required_unless_present = "udp", conflicts_with = "udp")]
    out: Option<PathBuf>,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Send the frames to HOST:PORT instead
    #[arg(long, value_name = "ADDRESS")]
    udp: Option<String>,
    /// Send no faster than this, bits per second
    #[arg(long, value_name = "BPS", requires = "udp", value_parser = clap::value_parser!(u32).range(1..))]
    bit_rate: Option<u32>,
}

/// Where frames go.
enum Sink {
    Folder(FrameFolder),
    Udp { socket: UdpSocket, bit_rate: Option<u32> },
}

impl Sink {
    fn new(args: &Args) -> anyhow::Result<Sink> {
        if let Some(folder) = &args.out {
            let kind = FrameKind::Ending("frame");
            return Ok(Sink::Folder(args.overwrite.open("--out", folder, kind)?));
        }
        let to = args.udp.as_deref().unwrap_or_default();
        let address = to.to_socket_addrs().with_context(|| format!("--udp {to}"))?.next();
        let address = address.with_context(|| format!("--udp {to}: no such host"))?;
        let own = if address.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" };
        let socket = UdpSocket::bind(own).context("opening a UDP socket")?;
        socket.connect(address).with_context(|| format!("--udp {to}"))?;
        Ok(Sink::Udp { socket, bit_rate: args.bit_rate })
    }

    fn put(&mut self, packet: &Path, index: usize, frame: &[u8]) -> anyhow::Result<()> {
        match self {
            Sink::Folder(folder) => {
                let stem = packet.file_stem().unwrap_or_default().to_string_lossy();
                folder.write(&format!("{stem}-{index:04}.frame"), frame)?;
                Ok(())
            }
            Sink::Udp { socket, bit_rate } => {
                match socket.send(frame) {
                    Err(error) if error.kind() == ErrorKind::ConnectionRefused => {
                        let to = socket.peer_addr()?;
                        anyhow::bail!(
                            "nobody listens at {to}: start `nvsprior join --udp` there first"
                        );
                    }
                    sent => sent.context("sending a frame")?,
                };
                if let Some(rate) = bit_rate {
                    let seconds = frame.len() as f64 * 8.0 / f64::from(*rate);
                    std::thread::sleep(Duration::from_secs_f64(seconds));
                }
                Ok(())
            }
        }
    }
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let mtu = usize::from(args.mtu);
    let (mut packets, mut sharer) = (Vec::new(), Sharer::default());
    for path in &args.packets {
        let bytes = std::fs::read(path).with_context(|| format!("reading {}", path.display()))?;
        // All packets are looked at before the first one is sent.
        sharer.split(&bytes, mtu).with_context(|| path.display().to_string())?;
        packets.push((path, bytes));
    }
    let mut sink = Sink::new(args)?;
    let mut frames = 0;
    for (path, bytes) in &packets {
        sharer.split(bytes, mtu)?;
        for (index, frame) in sharer.shares().enumerate() {
            sink.put(path, index, frame)?;
        }
        frames += sharer.count();
    }
    if let Sink::Folder(folder) = &mut sink {
        folder.finish()?;
    }
    say!("{} packets in {frames} frames of at most {mtu} bytes", packets.len());
    Ok(())
}
