//! Where modem frames come from: UDP, a serial line, standard input, or a recording.

use std::fs::File;
use std::io::BufReader;
use std::net::{SocketAddr, UdpSocket};
use std::path::PathBuf;
use std::sync::mpsc::SyncSender;
use std::time::Duration;

use anyhow::Context;

use super::clock::Clock;
use super::event::{Arrived, Event};
use super::framed::take_framed;
use super::recording::Player;
use super::serial::{SerialLine, SerialWriter};
use crate::endpoint::{self, DATAGRAM};

#[derive(clap::Args)]
#[group(required = true, multiple = false)]
pub struct SourceArgs {
    /// Take modem frames as datagrams at this UDP port; with ADDRESS:PORT at that address alone. Reports go to whoever
    /// sent the last valid one
    #[arg(long, value_name = "PORT", value_parser = endpoint::local)]
    udp: Option<SocketAddr>,
    /// Take modem frames from a serial port, say /dev/ttyUSB0, each in COBS with a zero byte behind it. Reports go back
    /// in the same way. BAUD: bits per second of the line, 9600 if it is left out. `-`: standard input; no reports are
    /// sent
    #[arg(long, value_name = "DEVICE[,BAUD]", value_parser = line)]
    serial: Option<Line>,
    /// Play a recording of a console again, SPEED times as fast as it was; 1 if it is left out
    #[arg(long, value_name = "FILE[,SPEED]", value_parser = played)]
    play: Option<(PathBuf, f64)>,
}

/// A line that modem frames come on.
#[derive(Clone)]
enum Line {
    Serial { device: String, baud: u32 },
    Stdin,
}

fn line(text: &str) -> Result<Line, String> {
    let (device, baud) = text.split_once(',').unwrap_or((text, "9600"));
    match baud.parse() {
        Ok(_) if text == "-" => Ok(Line::Stdin),
        Ok(baud) => Ok(Line::Serial { device: device.into(), baud }),
        Err(_) => Err(format!("\"{baud}\" is no number of bits per second")),
    }
}

fn played(text: &str) -> Result<(PathBuf, f64), String> {
    let (file, speed) = text.rsplit_once(',').unwrap_or((text, "1"));
    match speed.parse() {
        Ok(speed) if (0.01..=10_000.0).contains(&speed) => Ok((file.into(), speed)),
        _ => Err("the speed must lie between 0.01 and 10000".into()),
    }
}

/// Where reports go.
pub enum ReturnPath {
    Udp(UdpSocket),
    Serial(SerialWriter),
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
            (ReturnPath::Serial(line), _) => line.send(report),
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
    Serial(SerialLine),
    Stdin,
    Play(Player<BufReader<File>>),
}

impl SourceArgs {
    pub fn open(&self, mtu: usize) -> anyhow::Result<Source> {
        let mut clock = Clock::system();
        let (kind, name) = match self {
            SourceArgs { udp: Some(at), .. } => {
                let socket = endpoint::listen(*at)?;
                let at = socket.local_addr().context("--udp")?;
                (Kind::Udp(socket), format!("UDP {at}"))
            }
            SourceArgs { serial: Some(Line::Serial { device, baud }), .. } => {
                let line = SerialLine::open(device, *baud)?;
                (Kind::Serial(line), format!("{device} at {baud} baud"))
            }
            SourceArgs { play: Some((path, speed)), .. } => {
                let opening = || format!("--play {}", path.display());
                let file = BufReader::new(File::open(path).with_context(opening)?);
                let player = Player::open(file, path)?;
                clock = Clock::of_recording(player.start(), *speed);
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

    /// It is a recording, and not what comes now.
    pub fn is_recording(&self) -> bool {
        matches!(self.kind, Kind::Play(_))
    }

    pub fn clock(&self) -> Clock {
        self.clock
    }

    pub fn return_path(&self) -> anyhow::Result<ReturnPath> {
        Ok(match &self.kind {
            Kind::Udp(socket) => ReturnPath::Udp(socket.try_clone().context("--udp")?),
            Kind::Serial(line) => ReturnPath::Serial(line.writer()),
            Kind::Stdin | Kind::Play(_) => ReturnPath::None,
        })
    }

    /// Reads it on a thread of its own.
    pub fn start(self, events: SyncSender<Event>) -> anyhow::Result<()> {
        let Source { kind, mut clock, mtu, .. } = self;
        let read = move || {
            let why = match kind {
                Kind::Udp(socket) => Some(take_datagrams(&socket, clock, &events)),
                Kind::Serial(line) => line.take(clock, mtu, &events),
                Kind::Stdin => take_framed(std::io::stdin(), clock, mtu, &events),
                Kind::Play(player) => {
                    clock = Clock::of_recording(player.start(), clock.speed());
                    Some(play(player, clock, &events))
                }
            };
            // Nobody is there to hear it if the topside has ended.
            let _ = why.map(|why| events.send(Event::Stopped(why)));
        };
        std::thread::Builder::new().name("input".into()).spawn(read).context("reading")?;
        Ok(())
    }
}

/// Returns why no more come.
fn take_datagrams(socket: &UdpSocket, clock: Clock, events: &SyncSender<Event>) -> String {
    let mut buffer = vec![0; DATAGRAM];
    loop {
        match endpoint::receive(socket, Some(Duration::from_secs(60)), &mut buffer) {
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
