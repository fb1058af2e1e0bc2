//! `nvsprior vehicle`: frames to modem frames, as datagrams.

mod frames;

use std::net::{SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

use nvsprior::tracking::FrameInfo;
use nvsprior::{EncoderOptions, Picture};
use nvsprior_inputs::args::{DeviceArgs, PriorArgs};
use nvsprior_inputs::input::InputArgs;
use nvsprior_inputs::keys::KeyArgs;
use nvsprior_inputs::mode::ModeArgs;
use nvsprior_inputs::tune::TuneArgs;
use nvsprior_inputs::values::{self, WrongUsage};
use nvsprior_link::modem::Loss;
use nvsprior_link::{
    CameraFrame, LinkError, Pacing, Vehicle, VehicleEvent, VehicleLink, VehicleOptions,
};

use crate::endpoint;
use crate::journal::{Journal, LogArgs, utc};
use crate::state_file::{self, Side, StateFile};
use frames::{Frames, Next, Size};

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
}

impl Args {
    fn link(&self) -> anyhow::Result<(VehicleOptions, Option<StateFile>)> {
        let link = &self.link;
        let (state, file) = match &self.key.key {
            Some(key) => {
                StateFile::open(key, Side::Vehicle).map(|(state, file)| (state, Some(file)))?
            }
            None => (Vec::new(), None),
        };
        let options = VehicleOptions {
            pacing: Pacing::Rate(link.bit_rate),
            overhead: link.overhead,
            latency: link.latency,
            delay: link.delay,
            loss: Loss { chance: link.assume_loss, burst: link.burst },
            min_bytes: link.min_bytes,
            is_utc: true,
            keys: self.key.open()?,
            state,
            ..VehicleOptions::new(link.mtu.into(), link.bit_rate, self.frame_rate)
        };
        let made = VehicleLink::new(&options);
        match &file {
            Some(file) => state_file::check(made, file)?,
            None => _ = made.map_err(|error| WrongUsage(error.to_string()))?,
        }
        Ok((options, file))
    }

    fn encoder(&self) -> anyhow::Result<EncoderOptions> {
        let (mode, tune) = (self.mode.mode(true)?, self.tune.tune);
        Ok(EncoderOptions { threshold: self.threshold, mode, tune, ..Default::default() })
    }
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let (options, state) = args.link()?;
    let encoder = args.encoder()?;
    let frames = Frames::open(&args.input, args.raw, args.forth_and_back)?;
    let socket = endpoint::connect(args.to)?;
    let journal = args.log.open("vehicle")?;
    let engine = args.device.open()?;
    let scene = args.prior.upload(&engine)?;
    let vehicle = Vehicle::new(&engine, &scene, frames.camera(), encoder, &options)?;
    let mut dive = Dive {
        start: Instant::now(),
        start_utc: utc(),
        vehicle,
        journal,
        key: args.key.to_string(),
        state,
        socket,
        bit_rate: args.link.bit_rate,
        frame_rate: args.frame_rate,
        overhead: args.link.overhead,
        latency: args.link.latency,
        mtu: args.link.mtu.into(),
        is_slow: false,
        free: 0.0,
        buffer: vec![0; endpoint::DATAGRAM],
        counts: Counts::default(),
    };
    let prior = args.prior.prior.display();
    let start = format!("{} bit/s to {}, with {prior} ({})", dive.bit_rate, args.to, scene.id());
    dive.tell("start", &start);
    dive.go(frames)?;
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
    start_utc: f64,
    vehicle: Vehicle,
    journal: Journal,
    /// What the user calls it.
    key: String,
    /// Where the vehicle's state is stored; `None`: there are no keys.
    state: Option<StateFile>,
    socket: UdpSocket,
    bit_rate: f64,
    frame_rate: f64,
    overhead: usize,
    latency: f64,
    mtu: usize,
    is_slow: bool,
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

    /// The same as UTC: a clock that is set in the middle of a dive changes nothing.
    fn utc(&self) -> f64 {
        self.start_utc + self.now()
    }

    /// Tells what happens now.
    fn tell(&mut self, event: &str, text: &str) {
        self.journal.tell(utc(), event, text);
    }

    fn go(&mut self, mut frames: Frames) -> anyhow::Result<()> {
        let mut first = Some(frames.first());
        loop {
            match frames.next(self.now(), self.frame_rate)? {
                Next::Frame(frame) => {
                    self.work_until(frame.number as f64 / self.frame_rate)?;
                    self.send(&frame.picture, first.take().unwrap_or_default())?;
                }
                Next::Wait => self.work_until(self.now() + WAIT)?,
                Next::End => break,
            }
        }
        // What is left goes out.
        let last = self.now() + self.latency;
        self.work_until(last)
    }

    /// Sends a frame that is exposed now.
    fn send(&mut self, picture: &Picture, info: FrameInfo) -> anyhow::Result<()> {
        let (start, start_utc, exposed) = (self.start, self.start_utc, self.utc());
        self.counts.frames += 1;
        let frame = CameraFrame { exposed, picture, info, user: &[] };
        let ready = || start_utc + start.elapsed().as_secs_f64();
        let sent = self.vehicle.frame(exposed, &frame, ready)?;
        if sent.is_some() {
            self.counts.packets += 1;
            self.counts.uncertain += usize::from(!self.vehicle.encoded().stats.certain);
            self.send_due()?;
        }
        self.tell_events();
        Ok(())
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
        let now = self.start_utc + self.start.elapsed().as_secs_f64();
        let taken = self.vehicle.link().receive(now, bytes);
        self.counts.reports += usize::from(taken.is_ok());
        self.tell_events();
        Ok(true)
    }

    fn tell_events(&mut self) {
        while let Some(event) = self.vehicle.link().event() {
            self.tell_event(event);
        }
    }

    fn tell_event(&mut self, event: VehicleEvent) {
        let (event, text) = match event {
            VehicleEvent::TopsideHeard => ("topside", "the topside is heard".into()),
            VehicleEvent::TopsideSilent(seconds) => (
                "silence",
                format!("no report has come for {seconds:.0} s; frames are sent all the same"),
            ),
            VehicleEvent::Strangers(count) => {
                let key = &self.key;
                let text = format!(
                    "{count} datagrams came, and no report that can be read with {key}; give both sides the same"
                );
                ("keys", text)
            }
            VehicleEvent::Asked => ("asked", "the topside asks for a full packet".into()),
            VehicleEvent::Region(Some(_)) => ("region", "a region of interest".into()),
            VehicleEvent::Region(None) => ("region", "no region".into()),
            VehicleEvent::FrameRate(rate) if rate < self.frame_rate && !self.is_slow => {
                self.is_slow = true;
                let most = self.frame_rate;
                ("slow", format!("too slow for {most} frames per second, takes {rate:.1}"))
            }
            VehicleEvent::Store => return self.store(),
            VehicleEvent::FrameRate(_) | VehicleEvent::User => return,
        };
        self.tell(event, &text);
    }

    /// Stores what a vehicle with keys needs to start again. If it cannot be written, the dive goes on: a start again
    /// then takes another epoch.
    fn store(&mut self) {
        let Some(file) = &mut self.state else { return };
        let mut state = Vec::new();
        self.vehicle.link().state(&mut state);
        if let Err(error) = file.write(&state) {
            tell!("{error}; before a start again, give both sides the next --epoch");
            self.state = None;
        }
    }

    /// Sends what is due and takes reports, until a time.
    fn work_until(&mut self, time: f64) -> anyhow::Result<()> {
        self.take_waiting()?;
        loop {
            self.send_due()?;
            let now = self.now();
            if now >= time {
                return Ok(());
            }
            let due = self.vehicle.link().due().map(|due| (due - self.start_utc).max(self.free));
            let due = due.unwrap_or(f64::INFINITY);
            let within = Duration::from_secs_f64((due.min(time) - now).clamp(0.0, 1.0));
            self.take_datagram(Some(within))?;
        }
    }

    /// Sends the modem frames that are due, as fast as the link takes them. Those that waited for the encoder follow
    /// each other: the link's own queue has them then.
    fn send_due(&mut self) -> Result<(), LinkError> {
        let now = self.now();
        // What is to be stored is stored before more goes.
        self.tell_events();
        while self.free <= now
            && let due = self.vehicle.link().due()
            && let Some(frame) = self.vehicle.link().transmit(self.start_utc + now, self.mtu)?
        {
            // That nobody listens is no failure: they may do so later.
            let _ = self.socket.send(frame);
            let seconds = (frame.len() + self.overhead) as f64 * 8.0 / self.bit_rate;
            self.free = self.free.max(due.map_or(now, |due| due - self.start_utc)) + seconds;
        }
        Ok(())
    }
}
