//! Where modem frames come from: UDP, a serial line, standard input, or a recording.

use std::fs::File;
use std::io::{BufReader, Read, Write};
use std::net::{SocketAddr, UdpSocket};
use std::path::PathBuf;
use std::sync::mpsc::SyncSender;
use std::time::Duration;

use anyhow::Context;
use nvsprior_link::pilot::Region;

use super::clock::Clock;
use super::recording::Player;
use crate::endpoint::{self, DATAGRAM};

/// Events that may wait. If there are more datagrams, the next ones are dropped.
pub const EVENTS: usize = 1024;

/// What the topside is to deal with.
pub enum Event {
    /// A modem frame.
    Arrived(Arrived),
    /// No more will come.
    Ended(String),
    /// The pilot wants something.
    Command(Command),
}

pub struct Arrived {
    /// UTC, seconds.
    pub time: f64,
    pub bytes: Vec<u8>,
    /// Where reports to its sender go, of a datagram.
    pub from: Option<SocketAddr>,
}

#[derive(Clone, Copy, Debug)]
pub enum Command {
    Region(Option<Region>),
    Record(bool),
    Snapshot,
}

#[derive(clap::Args)]
#[group(required = true, multiple = false)]
struct Sources {
    /// Take modem frames as datagrams at this UDP port; with ADDRESS:PORT at that address alone. Reports go to whoever
    /// sent the last valid one
    #[arg(long, value_name = "PORT", value_parser = endpoint::local)]
    udp: Option<SocketAddr>,
    /// Take modem frames from a serial port, say /dev/ttyUSB0, each in COBS with a zero byte behind it. Reports go back
    /// in the same way
    #[arg(long, value_name = "DEVICE")]
    serial: Option<String>,
    /// Take modem frames on standard input, each in COBS with a zero byte behind it. No reports are sent
    #[arg(long)]
    stdin: bool,
    /// Play a recording of a console again
    #[arg(long, value_name = "FILE")]
    play: Option<PathBuf>,
}

#[derive(clap::Args)]
pub struct SourceArgs {
    #[command(flatten)]
    sources: Sources,
    /// Bits per second of the serial line
    #[arg(long, value_name = "BAUD", default_value_t = 9600)]
    baud: u32,
    /// Play so many times as fast as it was
    #[arg(long, value_name = "X", default_value_t = 1.0, value_parser = speed, requires = "play")]
    speed: f64,
}

fn speed(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(speed) if (0.01..=10_000.0).contains(&speed) => Ok(speed),
        _ => Err("must lie between 0.01 and 10000".into()),
    }
}

/// Where reports go.
pub enum ReturnPath {
    Udp(UdpSocket),
    Serial(Box<dyn Write + Send>),
    None,
}

impl ReturnPath {
    pub fn is_some(&self) -> bool {
        !matches!(self, ReturnPath::None)
    }

    /// Sends a report to whoever sent last. That it does not arrive is no failure: the next one tells the same.
    pub fn send(&mut self, report: &[u8], peer: Option<SocketAddr>) {
        let _ = match (self, peer) {
            (ReturnPath::Udp(socket), Some(peer)) => socket.send_to(report, peer).map(drop),
            (ReturnPath::Serial(port), _) => {
                let mut framed = cobs::encode_vec(report);
                framed.push(0);
                port.write_all(&framed)
            }
            _ => Ok(()),
        };
    }
}

/// A source that is open, and not read yet.
pub struct Source {
    kind: Kind,
    clock: Clock,
    mtu: usize,
    name: String,
}

enum Kind {
    Udp(UdpSocket),
    Serial(Box<dyn serialport::SerialPort>),
    Stdin,
    Play(Player<BufReader<File>>),
}

impl SourceArgs {
    pub fn open(&self, mtu: usize) -> anyhow::Result<Source> {
        let mut clock = Clock::system();
        let (kind, name) = match &self.sources {
            Sources { udp: Some(at), .. } => {
                let socket = endpoint::listen(*at)?;
                let at = socket.local_addr().context("--udp")?;
                (Kind::Udp(socket), format!("UDP {at}"))
            }
            Sources { serial: Some(device), .. } => {
                let port = serialport::new(device, self.baud).timeout(Duration::from_secs(1));
                let port = port.open().with_context(|| format!("--serial {device}"))?;
                (Kind::Serial(port), format!("{device} at {} baud", self.baud))
            }
            Sources { play: Some(path), .. } => {
                let opening = || format!("--play {}", path.display());
                let file = BufReader::new(File::open(path).with_context(opening)?);
                let player = Player::open(file, path)?;
                clock = Clock::of_recording(player.start(), self.speed);
                (Kind::Play(player), format!("the recording {}", path.display()))
            }
            _ => (Kind::Stdin, "standard input".into()),
        };
        Ok(Source { kind, clock, mtu, name })
    }
}

impl Source {
    pub fn name(&self) -> String {
        self.name.clone()
    }

    pub fn clock(&self) -> Clock {
        self.clock
    }

    pub fn return_path(&self) -> anyhow::Result<ReturnPath> {
        Ok(match &self.kind {
            Kind::Udp(socket) => ReturnPath::Udp(socket.try_clone().context("--udp")?),
            Kind::Serial(port) => {
                let port = port.try_clone().context("--serial")?;
                ReturnPath::Serial(Box::new(port))
            }
            Kind::Stdin | Kind::Play(_) => ReturnPath::None,
        })
    }

    /// Reads it on a thread of its own.
    pub fn start(self, events: SyncSender<Event>) -> anyhow::Result<()> {
        let Source { kind, mut clock, mtu, .. } = self;
        let read = move || {
            let ended = match kind {
                Kind::Udp(socket) => take_datagrams(&socket, clock, &events),
                Kind::Serial(port) => take_framed(port, clock, mtu, &events),
                Kind::Stdin => take_framed(std::io::stdin(), clock, mtu, &events),
                Kind::Play(player) => {
                    clock = Clock::of_recording(player.start(), clock.speed());
                    play(player, clock, &events)
                }
            };
            // Nobody is there to hear it if the topside has ended.
            let _ = events.send(Event::Ended(ended));
        };
        std::thread::Builder::new().name("input".into()).spawn(read).context("reading")?;
        Ok(())
    }
}

/// Returns why no more come.
fn take_datagrams(socket: &UdpSocket, clock: Clock, events: &SyncSender<Event>) -> String {
    let mut buffer = vec![0; DATAGRAM];
    loop {
        match endpoint::receive(socket, Duration::from_secs(60), &mut buffer) {
            Ok(None) => {}
            Ok(Some((bytes, from))) => {
                let bytes = bytes.to_vec();
                let arrived = Arrived { time: clock.now(), bytes, from: Some(from) };
                // If the topside does not keep up, datagrams are dropped: as if they were lost on the way.
                let _ = events.try_send(Event::Arrived(arrived));
            }
            Err(error) => return format!("reading datagrams failed: {error}"),
        }
    }
}

/// Takes modem frames from a line of bytes: each is in COBS, with a zero byte behind it. What is none is handed on as
/// it came, and counts as garbage there.
fn take_framed(
    mut input: impl Read,
    clock: Clock,
    mtu: usize,
    events: &SyncSender<Event>,
) -> String {
    let mut splitter = Splitter::new(mtu);
    let mut buffer = [0; 4096];
    loop {
        let read = match input.read(&mut buffer) {
            Ok(0) => return "the input ended".into(),
            Ok(read) => read,
            Err(error) => match error.kind() {
                std::io::ErrorKind::TimedOut | std::io::ErrorKind::Interrupted => continue,
                _ => return format!("reading failed: {error}"),
            },
        };
        for byte in &buffer[..read] {
            let Some(bytes) = splitter.take(*byte) else { continue };
            let arrived = Arrived { time: clock.now(), bytes, from: None };
            if events.send(Event::Arrived(arrived)).is_err() {
                return String::new();
            }
        }
    }
}

/// Divides a line of bytes at its zeros.
struct Splitter {
    bytes: Vec<u8>,
    longest: usize,
}

impl Splitter {
    fn new(mtu: usize) -> Splitter {
        Splitter { bytes: Vec::new(), longest: cobs::max_encoding_length(mtu) }
    }

    /// Takes a byte; gives the modem frame that it ends.
    fn take(&mut self, byte: u8) -> Option<Vec<u8>> {
        if byte != 0 {
            // Of what is too long, the rest is not kept.
            if self.bytes.len() <= self.longest {
                self.bytes.push(byte);
            }
            return None;
        }
        let bytes = std::mem::take(&mut self.bytes);
        match bytes.is_empty() {
            true => None,
            false => Some(cobs::decode_vec(&bytes).unwrap_or(bytes)),
        }
    }
}

fn play(player: Player<BufReader<File>>, clock: Clock, events: &SyncSender<Event>) -> String {
    for recorded in player.frames() {
        std::thread::sleep(clock.until(recorded.time));
        let arrived = Arrived { time: recorded.time, bytes: recorded.bytes, from: None };
        if events.send(Event::Arrived(arrived)).is_err() {
            break;
        }
    }
    "the recording has ended".into()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn split(line: &[u8]) -> Vec<Vec<u8>> {
        let mut splitter = Splitter::new(8);
        line.iter().filter_map(|byte| splitter.take(*byte)).collect()
    }

    #[test]
    fn modem_frames_come_out_of_a_line_of_bytes() {
        let frames = [vec![0, 1, 0, 0], vec![9; 8], vec![0]];
        let mut line = vec![0, 0];
        for frame in &frames {
            line.extend(cobs::encode_vec(frame));
            line.push(0);
        }
        assert_eq!(split(&line), frames);
    }

    #[test]
    fn noise_is_handed_on_and_bounded() {
        let long = split(&[&[7; 100_000][..], &[0]].concat());
        assert!(long.len() == 1 && long[0].len() <= 10);
        let [one, two] = &split(&[200, 3, 0, 2, 5, 0])[..] else { panic!() };
        assert_eq!((&one[..], &two[..]), (&[200, 3][..], &[5][..]));
    }
}
