//! `nvsprior vehicle`: frames to modem frames, as datagrams.

mod frames;
mod pace;
mod reports;

use std::net::{SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

use nvsprior::Picture;
use nvsprior::keys::Keys;
use nvsprior::modem::{
    Loss, ModemError, Protection, RateControlOptions, Report, Sender, SenderOptions,
};
use nvsprior::tracking::FrameInfo;
use nvsprior_inputs::args::{DeviceArgs, PriorArgs};
use nvsprior_inputs::input::InputArgs;
use nvsprior_inputs::keys::KeyArgs;
use nvsprior_inputs::mode::ModeArgs;
use nvsprior_inputs::tune::TuneArgs;
use nvsprior_inputs::values::{self, WrongUsage};
use nvsprior_link::age_limit::AgeLimit;
use nvsprior_link::exposure::{self, ClockSource, EXPOSURE_LEN, TopsideClock};
use nvsprior_link::pilot::{PilotMessage, Region};
use nvsprior_link::vehicle::{CameraFrame, Vehicle, VehicleOptions};

use crate::endpoint;
use crate::journal::{Journal, LogArgs, utc};
use crate::key_state::{KeyState, Side};
use frames::{Frames, Next, Size};
use pace::Pace;
use reports::{FullPackets, Heard, Hearing};

/// Send frames to a topside: the vehicle's half of a working link
///
/// Frames come at --frame-rate: those of the camera file, or raw ones on standard input (--raw). Each is encoded in the
/// bytes that the link has for it, and goes as datagrams, one modem frame each, to --to. Frames for which there is no
/// time or no room are left out. Reports of the topside are taken on the same socket: what it lacks, what it holds, and
/// the pilot's region of interest.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    prior: PriorArgs,
    #[command(flatten)]
    input: InputArgs,
    /// Frames come on standard input, as RGB of this size, 8 bits a channel, row by row without gaps. The camera file's
    /// first frame tells camera and start pose
    #[arg(long, value_name = "WxH", conflicts_with = "forth_and_back")]
    raw: Option<Size>,
    /// Go through the frames forth and back, until the program is stopped
    #[arg(long)]
    forth_and_back: bool,
    /// Where the topside listens, or a modem's driver
    #[arg(long, value_name = "ADDRESS:PORT", value_parser = endpoint::remote)]
    to: SocketAddr,
    /// Camera frames per second
    #[arg(long, value_name = "N", default_value_t = 15.0, value_parser = values::frame_rate)]
    frame_rate: f64,
    #[command(flatten)]
    link: LinkArgs,
    #[command(flatten)]
    mode: ModeArgs,
    #[command(flatten)]
    tune: TuneArgs,
    #[command(flatten)]
    key: KeyArgs,
    /// See `nvsprior encode`
    #[arg(long, value_name = "MSE", default_value_t = 1e-2, value_parser = values::mse, allow_hyphen_values = true)]
    threshold: f64,
    #[command(flatten)]
    log: LogArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

#[derive(clap::Args)]
struct LinkArgs {
    /// What the link carries, bits per second
    #[arg(long, value_name = "BPS", default_value_t = 5000.0, value_parser = values::rate)]
    bit_rate: f64,
    /// Most bytes of a modem frame. The topside must be told the same
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u16).range(16..))]
    mtu: u16,
    /// What a modem frame takes beside its bytes, as bytes
    #[arg(long, value_name = "BYTES", default_value_t = 0, value_parser = values::count)]
    overhead: usize,
    /// Longest time from a frame's exposure to the end of its last modem frame, seconds
    #[arg(long, value_name = "S", default_value_t = 2.0, value_parser = values::seconds)]
    latency: f64,
    /// What of it is no transmission: search, coding, propagation; seconds
    #[arg(long, value_name = "S", default_value_t = 0.5, value_parser = values::seconds)]
    delay: f64,
    /// Part of modem frames that packets are protected against at first; reports then tell the loss
    #[arg(long, value_name = "X", default_value_t = 0.1, value_parser = values::not_negative)]
    assume_loss: f64,
    /// Mean number of modem frames that are lost in a row
    #[arg(long, value_name = "N", default_value_t = 1.0, value_parser = values::not_negative)]
    burst: f64,
    /// Fewest bytes for a picture, all counted: below it frames are left out
    #[arg(long = "least", value_name = "BYTES", default_value_t = 100, value_parser = values::count)]
    min_bytes: usize,
    /// Most modem frames of a packet
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u16).range(1..=64))]
    shares: u16,
}

impl Args {
    /// # Errors
    /// If the link cannot be.
    fn sender(&self, keys: Option<&Keys>) -> Result<SenderOptions, ModemError> {
        let link = &self.link;
        let loss = Loss { chance: link.assume_loss, burst: link.burst };
        let left = (link.latency - link.delay).max(0.0);
        let control = RateControlOptions {
            bit_rate: link.bit_rate,
            mtu: link.mtu.into(),
            overhead: link.overhead,
            latency: link.latency,
            delay: link.delay,
            spread: if loss.chance > 0.0 { 0.25 * left } else { 0.0 },
            frame_rate: self.frame_rate,
            min_bytes: link.min_bytes,
            max_shares: link.shares.into(),
            loss,
            user: Some(EXPOSURE_LEN),
        };
        let options = SenderOptions {
            control,
            stream: 0,
            protection: Protection::Layers,
            expect_reports: true,
        };
        match keys {
            Some(keys) => Sender::with_keys(options, keys)?,
            None => Sender::new(options)?,
        };
        Ok(options)
    }
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let keys = args.key.open()?;
    let sender = args.sender(keys.as_ref()).map_err(|error| WrongUsage(error.to_string()))?;
    let mode = args.mode.mode(true)?;
    let frames = Frames::open(&args.input, args.raw, args.forth_and_back)?;
    let socket = endpoint::connect(args.to)?;
    let journal = args.log.open("vehicle")?;
    let keyed = args.key.key.as_ref().zip(keys);
    let keyed = keyed.map(|(path, keys)| KeyState::open(path, Side::Vehicle, keys)).transpose()?;
    let (keys, key_state) = keyed.unzip();
    let engine = args.device.open()?;
    let scene = args.prior.upload(&engine)?;
    let (threshold, frames_treated) = (args.threshold, false);
    let tune = args.tune.tune();
    let options = VehicleOptions {
        sender,
        mode,
        tune,
        threshold,
        frames_treated,
        truth: true,
        predict_poses: true,
    };
    let vehicle = Vehicle::new(&engine, &scene, frames.camera(), &options, keys.as_ref())?;
    let mut dive = Dive {
        start: Instant::now(),
        vehicle,
        journal,
        key: args.key.to_string(),
        hearing: Hearing::default(),
        full: FullPackets::default(),
        key_state,
        socket,
        bit_rate: args.link.bit_rate,
        overhead: args.link.overhead,
        limit: AgeLimit::of(&sender.control),
        clock: TopsideClock::default(),
        region: None,
        free: 0.0,
        buffer: vec![0; endpoint::DATAGRAM],
        counts: Counts::default(),
    };
    let prior = args.prior.prior.display();
    let start = format!("{} bit/s to {}, with {prior} ({})", dive.bit_rate, args.to, scene.id());
    dive.tell("start", &start);
    dive.go(frames, args.frame_rate)?;
    let Counts { frames, packets, uncertain, reports } = dive.counts;
    let end = format!(
        "{packets} of {frames} frames sent, {uncertain} not certain; {reports} reports came"
    );
    dive.tell("end", &end);
    args.device.check(&engine)
}

/// Seconds between two looks for a raw frame.
const WAIT: f64 = 0.01;
/// Datagrams that wait are taken after each frame: at most so many, and for so long. The rest waits for the next frame.
const WAITING: usize = 4096;
const TAKING: Duration = Duration::from_millis(50);

#[derive(Default)]
struct Counts {
    frames: usize,
    packets: usize,
    uncertain: usize,
    reports: usize,
}

struct Dive {
    start: Instant,
    vehicle: Vehicle,
    journal: Journal,
    /// What the user calls it.
    key: String,
    hearing: Hearing,
    full: FullPackets,
    key_state: Option<KeyState>,
    socket: UdpSocket,
    bit_rate: f64,
    overhead: usize,
    /// Of the age of pictures, as packets tell it.
    limit: AgeLimit,
    clock: TopsideClock,
    region: Option<Region>,
    /// When the link has sent what it was given, seconds since the start.
    free: f64,
    buffer: Vec<u8>,
    counts: Counts,
}

impl Dive {
    /// Seconds since the start.
    fn now(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }

    /// Tells what happens now.
    fn tell(&mut self, event: &str, text: &str) {
        self.journal.tell(utc(), event, text);
    }

    fn go(&mut self, mut frames: Frames, frame_rate: f64) -> anyhow::Result<()> {
        let mut first = Some(frames.first());
        let (mut pace, mut is_slow) = (Pace::full(), false);
        loop {
            match frames.next(self.now(), frame_rate)? {
                Next::Frame(frame) => {
                    self.work_until(frame.number as f64 / frame_rate)?;
                    let number = pace.number(frame.number);
                    self.send(number, &frame.picture, first.take().unwrap_or_default())?;
                    let Some(part) = pace.take(frame.number) else { continue };
                    let taken = frame_rate * part;
                    // Each frame then has its part of the rate.
                    self.vehicle.set_frame_rate(taken)?;
                    if part < 1.0 && !std::mem::replace(&mut is_slow, true) {
                        let text = format!(
                            "too slow for {frame_rate} frames per second, takes {taken:.1}"
                        );
                        self.tell("slow", &text);
                    }
                }
                Next::Wait => self.work_until(self.now() + WAIT)?,
                Next::End => break,
            }
        }
        // What is left goes out.
        let last = self.now() + self.vehicle.latency();
        self.work_until(last)
    }

    /// Sends a frame that is exposed now.
    fn send(&mut self, number: usize, picture: &Picture, info: FrameInfo) -> anyhow::Result<()> {
        let exposed = self.now();
        let user = self.stamp(exposed);
        self.counts.frames += 1;
        let taken = CameraFrame {
            number,
            exposed,
            picture,
            info: FrameInfo { time: Some(exposed), ..info },
            user: Some(&user),
        };
        let start = self.start;
        let packet = self.vehicle.take(&taken, || start.elapsed().as_secs_f64())?;
        let Some(packet) = packet else { return Ok(()) };
        self.counts.packets += 1;
        self.counts.uncertain += usize::from(!packet.certain);
        let seconds = packet.bytes.total() as f64 * 8.0 / self.bit_rate;
        self.full.sent(self.now(), seconds);
        self.send_due();
        Ok(())
    }

    /// When a frame was exposed, as its packet tells it.
    fn stamp(&self, exposed: f64) -> [u8; EXPOSURE_LEN] {
        match self.clock.at(exposed) {
            Some(topside) => exposure::written(topside, ClockSource::Reports, self.limit),
            None => exposure::written(utc(), ClockSource::Vehicle, self.limit),
        }
    }

    /// Takes what waits on the socket, however late it is: a vehicle that is slower than its frame rate would hear
    /// nothing else. What is no report costs next to nothing.
    fn take_waiting(&mut self) -> anyhow::Result<()> {
        let begun = Instant::now();
        for _ in 0..WAITING {
            if begun.elapsed() > TAKING || !self.take_datagram(None)? {
                break;
            }
        }
        Ok(())
    }

    /// Takes a datagram that comes within a time, or that waits; false: none.
    fn take_datagram(&mut self, within: Option<Duration>) -> anyhow::Result<bool> {
        let received = endpoint::receive(&self.socket, within, &mut self.buffer)?;
        let Some((bytes, _)) = received else { return Ok(false) };
        let Ok((report, user)) = self.vehicle.read_report(bytes) else {
            let heard = self.hearing.stranger();
            self.tell_heard(heard);
            return Ok(true);
        };
        let message = user.and_then(PilotMessage::read);
        self.take_report(&report, message)?;
        Ok(true)
    }

    fn tell_heard(&mut self, heard: Option<Heard>) {
        let Some(heard) = heard else { return };
        let key = &self.key;
        let (event, text) = match heard {
            Heard::Came => ("topside", "the topside is heard".into()),
            Heard::Away(seconds) => (
                "silence",
                format!("no report has come for {seconds:.0} s; frames are sent all the same"),
            ),
            Heard::Strangers(count) => (
                "keys",
                format!(
                    "{count} datagrams came, and no report that can be read with {key}; give both sides the same"
                ),
            ),
        };
        self.tell(event, &text);
    }

    /// Sends what is due and takes reports, until a time.
    fn work_until(&mut self, time: f64) -> anyhow::Result<()> {
        self.take_waiting()?;
        let heard = self.hearing.silence(self.now());
        self.tell_heard(heard);
        loop {
            self.send_due();
            let now = self.now();
            if now >= time {
                return Ok(());
            }
            let due = self.vehicle.due().map(|due| due.max(self.free)).unwrap_or(f64::INFINITY);
            let within = Duration::from_secs_f64((due.min(time) - now).clamp(0.0, 1.0));
            self.take_datagram(Some(within))?;
        }
    }

    /// Sends the modem frames that are due, as fast as the link takes them. Those that waited for the encoder follow
    /// each other: the link's own queue has them then.
    fn send_due(&mut self) {
        let now = self.now();
        self.keep_numbers();
        while self.free <= now
            && let Some((due, share)) = self.vehicle.next_share(now)
        {
            // That nobody listens is no failure: they may do so later.
            let _ = self.socket.send(share);
            let seconds = (share.len() + self.overhead) as f64 * 8.0 / self.bit_rate;
            self.free = self.free.max(due) + seconds;
        }
    }

    /// Keeps what a vehicle with keys needs to start again. If it cannot be written, the dive goes on: a start again
    /// then takes another epoch.
    fn keep_numbers(&mut self) {
        let Some((state, next)) = self.key_state.as_mut().zip(self.vehicle.next_number()) else {
            return;
        };
        if let Err(error) = state.keep(next, self.vehicle.seen()) {
            eprintln!("{error}; before a start again, give both sides the next --epoch");
            self.key_state = None;
        }
    }

    fn take_report(
        &mut self,
        report: &Report,
        message: Option<PilotMessage>,
    ) -> anyhow::Result<()> {
        let now = self.now();
        // A report of another stream is none for this vehicle.
        if self.vehicle.process_report(now, report).is_err() {
            return Ok(());
        }
        self.counts.reports += 1;
        let heard = self.hearing.report(now);
        self.tell_heard(heard);
        let Some(PilotMessage { sent, announce, region }) = message else { return Ok(()) };
        self.clock.reported(now, sent);
        if announce && self.full.ask(now) {
            self.vehicle.encoder().announce();
            self.tell("asked", "the topside asks for a full packet");
        }
        if region != self.region {
            let encoder = self.vehicle.encoder();
            let size = (encoder.camera().width, encoder.camera().height);
            encoder.set_interest(region.map(|region| region.interest(size)).transpose()?);
            self.region = region;
            self.tell(
                "region",
                if region.is_some() { "a region of interest" } else { "no region" },
            );
        }
        Ok(())
    }
}
