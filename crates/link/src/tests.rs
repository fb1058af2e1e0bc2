//! Both ends over a link that loses, delays, swaps and repeats, with restarts, clocks that jump, and changes of MTU and
//! keys: with the device, and with a stub in its place, whose packets are real ones and whose pictures tell of which
//! frame they are. `make link-soak` runs many dives.

mod device;
mod stub;

use std::collections::BTreeMap;

use super::*;
use crate::keys::{Key, Keys};
use crate::modem::{Loss, Protection};
use nvsprior::random::Random;
use nvsprior::{Decoded, Pose};

/// What stands in the water: the ends' encoders and decoders.
trait World {
    type Encoder: Coder;
    type Decoder: LinkDecoder;

    /// The encoder of a vehicle's run, the number of its first frame, and whether poses are predicted.
    fn encoder(&self, run: u32, first: u32, stream: bool, predicts: bool) -> Self::Encoder;
    fn decoder(&self) -> Self::Decoder;
    /// What a picture shows, in a number.
    fn content(decoded: &Decoded) -> u64;
}

/// An encoder of a dive.
trait Coder: LinkEncoder {
    /// The packet of a frame in so many bytes, what its picture will show, and its pose.
    fn code(&mut self, number: u32, bytes: usize, time: f64) -> (Vec<u8>, Told);
}

/// Frames of a dive.
const FRAMES: usize = 50;
/// Seconds that coding takes.
const CODING: f64 = 0.1;
/// Camera frames per second.
const RATE: f64 = 5.0;
/// Within so many camera frames after all is well again a picture of late is shown.
const BACK: usize = 40;
/// Frames after which prior and camera are stated again.
const CAMERA_INTERVAL: u32 = 64;

/// What a dive is like.
#[derive(Clone, Debug)]
struct Weather {
    mtu: usize,
    protection: Protection,
    pacing: Pacing,
    stream: bool,
    reports: bool,
    keys: bool,
    in_order: bool,
    loss: f32,
    /// Seconds on the way at least, and more at most.
    way: [f32; 2],
    repeats: f32,
    /// Chance of trouble per frame.
    trouble: f32,
}

impl Weather {
    fn new(random: &mut Random) -> Weather {
        let mut one_of = |count: usize| random.within(0.0, count as f32 - 0.01) as usize;
        let mtu = [8, 16, 20, 32, 64, 200][one_of(6)];
        let protection = match mtu < 20 || one_of(4) == 0 {
            true => Protection::None,
            false => Protection::Layers,
        };
        let keys = mtu > 22 && one_of(3) == 0;
        let rate = [1_500.0, 4_000.0, 12_000.0][one_of(3)];
        // Of the smallest modem frames only eight packets can be told apart.
        let ways = if mtu < 16 { [[0.1, 0.1]; 3] } else { [[0.05, 0.0], [0.3, 0.4], [0.8, 1.0]] };
        Weather {
            mtu,
            protection,
            pacing: if one_of(3) == 0 { Pacing::Pull } else { Pacing::Rate(rate) },
            stream: one_of(3) == 0,
            reports: one_of(4) > 0,
            keys,
            in_order: one_of(2) == 0,
            loss: [0.0, 0.05, 0.2, 0.4][one_of(4)],
            way: ways[one_of(3)],
            repeats: 0.05,
            trouble: 0.06,
        }
    }
}

/// A packet that was sent: what its frame saw, and its pose.
type Told = (u64, Pose);

/// Both ends, and what is on its way.
struct Dive<'a, W: World> {
    world: &'a W,
    weather: Weather,
    random: Random,
    time: f64,
    /// By how much each side's clock is off, seconds.
    clocks: [f64; 2],
    epoch: u64,
    run: u32,
    vehicle: VehicleLink,
    encoder: W::Encoder,
    topside: Topside<W::Decoder>,
    states: [Vec<u8>; 2],
    /// On their way down and up: when they arrive.
    up: Vec<(f64, Vec<u8>)>,
    down: Vec<(f64, Vec<u8>)>,
    /// When the modem is free.
    free: f64,
    /// A packet, and when it is ready.
    coded: Option<(f64, Vec<u8>)>,
    /// By frame number modulo 2¹⁶.
    told: BTreeMap<u16, Vec<Told>>,
    /// Own pictures that were shown: the camera frame at that time, and whether all of the packet was there.
    shown: Vec<(usize, bool)>,
    frame: usize,
    calm: bool,
}

fn keys(weather: &Weather, epoch: u64) -> Option<Keys> {
    weather.keys.then(|| Keys::new([Key::new([9; 32])]).unwrap().with_epoch(epoch))
}

fn vehicle_options(weather: &Weather, epoch: u64, state: &[u8]) -> VehicleOptions {
    VehicleOptions {
        pacing: weather.pacing,
        latency: 3.0,
        delay: 0.2,
        protection: weather.protection,
        loss: Loss { chance: 0.1, burst: 1.0 },
        expect_reports: weather.reports,
        is_utc: true,
        keys: keys(weather, epoch),
        state: state.to_vec(),
        min_bytes: 30,
        ..VehicleOptions::new(weather.mtu, 1.0, RATE)
    }
}

fn topside_options(weather: &Weather, epoch: u64, state: &[u8]) -> TopsideOptions {
    let in_order = Playout::InOrder { latency: 2.0, frame_rate: Some(RATE) };
    TopsideOptions {
        playout: if weather.in_order { in_order } else { Playout::Newest },
        report_every: weather.reports.then_some(1.0),
        modem_checks: weather.mtu < 16,
        // Less than four packets take.
        age: (weather.mtu < 16).then_some(3.0 / RATE),
        is_utc: true,
        keys: keys(weather, epoch),
        state: state.to_vec(),
        ..TopsideOptions::new(weather.mtu)
    }
}

impl<'a, W: World> Dive<'a, W> {
    fn new(world: &'a W, seed: u64) -> Dive<'a, W> {
        let mut random = Random::new(seed);
        let weather = Weather::new(&mut random);
        let vehicle = VehicleLink::new(&vehicle_options(&weather, 1, &[])).unwrap();
        let topside = Topside::with(world.decoder(), &topside_options(&weather, 1, &[])).unwrap();
        let encoder = world.encoder(0, vehicle.next_frame(), weather.stream, weather.reports);
        Dive {
            world,
            weather,
            random,
            time: 1000.0,
            clocks: [0.0; 2],
            epoch: 1,
            run: 0,
            vehicle,
            encoder,
            topside,
            states: [Vec::new(), Vec::new()],
            up: Vec::new(),
            down: Vec::new(),
            free: 0.0,
            coded: None,
            told: BTreeMap::new(),
            shown: Vec::new(),
            frame: 0,
            calm: false,
        }
    }

    fn chance(&mut self, chance: f32) -> bool {
        self.random.within(0.0, 1.0) < chance
    }

    fn now(&self, side: usize) -> f64 {
        self.time + self.clocks[side]
    }

    /// A camera frame, and the time until the next one.
    fn step(&mut self) {
        if !self.calm && self.chance(self.weather.trouble) {
            self.trouble();
        }
        self.expose();
        for _ in 0..4 {
            self.time += 0.25 / RATE;
            self.work();
        }
        self.frame += 1;
    }

    fn expose(&mut self) {
        let now = self.now(0);
        let Some(planned) = self.vehicle.plan(now, now).unwrap() else { return };
        self.vehicle.instruct(&mut self.encoder).unwrap();
        let (packet, told) = self.encoder.code(planned.number, planned.bytes, self.time);
        self.told.entry(planned.number as u16).or_default().push(told);
        self.coded = Some((self.time + CODING, packet));
    }

    /// Sends the packet that is coded, once it is.
    fn push(&mut self) {
        let now = self.now(0);
        if let Some((_, packet)) = self.coded.take_if(|(ready, _)| *ready <= self.time) {
            // That a packet finds no room is no failure.
            let _ = self.vehicle.push(now, &packet, &[]);
        }
    }

    fn work(&mut self) {
        while let Some(event) = self.vehicle.event() {
            if event == VehicleEvent::Store {
                self.vehicle.state(&mut self.states[0]);
            }
        }
        while let Some(event) = self.topside.link().event() {
            if event == TopsideEvent::Store {
                self.topside.link().state(&mut self.states[1]);
            }
        }
        self.push();
        self.transmit();
        self.arrive();
        self.look();
        let now = self.now(1);
        if let Some(report) = self.topside.report(now).unwrap() {
            let report = report.to_vec();
            self.carry(report, false);
        }
    }

    fn transmit(&mut self) {
        let (now, mtu) = (self.now(0), self.weather.mtu);
        while self.free <= self.time {
            let Some(frame) = self.vehicle.transmit(now, mtu).unwrap() else { break };
            let frame = frame.to_vec();
            assert!(frame.len() <= mtu);
            let rate = match self.weather.pacing {
                Pacing::Rate(rate) => rate,
                _ => 4_000.0,
            };
            // What the modem was free for since the last look.
            let since = self.free.max(self.time - 0.25 / RATE);
            self.free = since + frame.len() as f64 * 8.0 / rate;
            self.carry(frame, true);
        }
        if self.weather.pacing == Pacing::Pull && self.free <= self.time {
            // The other traffic's turn.
            self.free = self.time + 0.05;
        }
    }

    /// Sends bytes on their way, if they are not lost.
    fn carry(&mut self, bytes: Vec<u8>, up: bool) {
        let Weather { loss, way: [least, more], repeats, .. } = self.weather;
        let loss = if self.calm { 0.0 } else { loss };
        let times = 1 + usize::from(self.chance(repeats));
        for _ in 0..times {
            let late = self.random.within(0.0, 1.0);
            if !self.chance(loss) {
                let arrival = self.time + f64::from(least + more * late);
                if up { &mut self.up } else { &mut self.down }.push((arrival, bytes.clone()));
            }
        }
    }

    fn arrive(&mut self) {
        let time = self.time;
        let take = |on_way: &mut Vec<(f64, Vec<u8>)>| {
            let mut came: Vec<_> = on_way.extract_if(.., |(arrival, _)| *arrival <= time).collect();
            came.sort_by(|a, b| a.0.total_cmp(&b.0));
            came
        };
        let now = [self.now(0), self.now(1)];
        for (_, bytes) in take(&mut self.up) {
            let _ = self.topside.receive(now[1], &bytes);
        }
        for (_, bytes) in take(&mut self.down) {
            let _ = self.vehicle.receive(now[0], &bytes);
        }
    }

    /// Looks at all pictures: none that is wrong is shown as right.
    fn look(&mut self) {
        let now = self.now(1);
        while let Some((decoded, shown)) = self.topside.picture(now).unwrap() {
            if shown.shows == Shows::Between {
                continue;
            }
            let told = self.told.get(&(decoded.frame as u16)).map_or(&[][..], Vec::as_slice);
            let content = W::content(decoded);
            let is_whole = shown.complete && decoded.damage.is_none();
            let same =
                |(seen, pose): &&Told| *pose == decoded.pose && (!is_whole || *seen == content);
            assert!(
                told.iter().any(|told| same(&told)),
                "frame {} at {:.2}: {content:#x} {:?} of {told:x?}",
                decoded.frame,
                self.time,
                decoded.pose
            );
            assert_eq!(number_of_u16(shown.frame), decoded.frame as u16);
            self.shown.push((self.frame, shown.complete));
        }
    }

    /// Something happens that should not.
    fn trouble(&mut self) {
        match self.random.within(0.0, 5.99) as u32 {
            0 => self.restart_vehicle(),
            1 => self.restart_topside(),
            2 | 3 => {
                let side = usize::from(self.chance(0.5));
                let far = [1.5, 30.0, 5_000.0, 1e6][self.random.within(0.0, 3.99) as usize];
                let sign = if self.chance(0.5) { 1.0 } else { -1.0 };
                self.clocks[side] += sign * far;
            }
            4 => {
                // The modem goes to another mode; one side hears of it before the other.
                if self.weather.mtu >= 32 {
                    self.weather.mtu = if self.weather.mtu == 32 { 64 } else { 32 };
                    self.restart_both();
                }
            }
            _ if self.weather.keys => {
                self.epoch += 1;
                self.restart_both();
            }
            _ => self.time += f64::from(self.random.within(0.0, 20.0)),
        }
    }

    fn restart_both(&mut self) {
        self.restart_vehicle();
        for _ in 0..3 {
            self.expose();
            self.time += 1.0 / RATE;
            self.work();
        }
        self.restart_topside();
    }

    fn restart_vehicle(&mut self) {
        // Without keys nobody may have stored the state.
        let forget = !self.weather.keys && self.chance(0.5);
        let state = if forget { Vec::new() } else { self.states[0].clone() };
        let options = vehicle_options(&self.weather, self.epoch, &state);
        self.vehicle = VehicleLink::new(&options).unwrap();
        self.coded = None;
        self.run += 1;
        let first = self.vehicle.next_frame();
        let Weather { stream, reports, .. } = self.weather;
        self.encoder = self.world.encoder(self.run, first, stream, reports);
    }

    fn restart_topside(&mut self) {
        let forget = !self.weather.keys && self.chance(0.5);
        let state = if forget { Vec::new() } else { self.states[1].clone() };
        let options = topside_options(&self.weather, self.epoch, &state);
        self.topside = Topside::with(self.world.decoder(), &options).unwrap();
    }
}

fn number_of_u16(frame: i64) -> u16 {
    frame.rem_euclid(1 << 16) as u16
}

/// A dive with trouble, and then without. Tells how many frames passed until a new whole picture was shown.
fn dive(world: &impl World, seed: u64) -> usize {
    let mut dive = Dive::new(world, seed);
    (0..FRAMES).for_each(|_| dive.step());
    dive.calm = true;
    let (from, before) = (dive.frame, dive.shown.len());
    // Nobody asks for prior and camera without a return channel, and the smallest reports have no room for it.
    let asks = dive.weather.reports && dive.weather.mtu >= 16;
    let unasked = if asks { 0 } else { CAMERA_INTERVAL as usize };
    let limit = BACK + (4.0 * RATE) as usize + unasked;
    while dive.frame < from + limit {
        dive.step();
        let new = &dive.shown[before..];
        // Two of them, so that none was on its way before. The newest is often not whole yet.
        let is_back = |(frame, is_whole): &&(usize, bool)| {
            *frame > from + 10 && (*is_whole || !dive.weather.in_order)
        };
        if new.iter().filter(is_back).count() >= 2 {
            return dive.frame - from;
        }
    }
    let (sent, came) = (dive.vehicle.statistics(), dive.topside.link().statistics());
    let (weather, refusal) = (&dive.weather, dive.topside.refusal());
    panic!(
        "seed {seed}: not back within {limit} frames: {weather:?}; {refusal:?}; {sent:?}; {came:?}"
    );
}

/// So many dives as a variable of the environment says, from the seed `SEED` on.
fn dives(world: &impl World, variable: &str, usual: u64) {
    let number = |name: &str, usual: u64| {
        std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(usual)
    };
    let (dives, seed) = (number(variable, usual), number("SEED", 1));
    let mut back: Vec<usize> = (seed..seed + dives).map(|seed| dive(world, seed)).collect();
    back.sort_unstable();
    let at = |part: f64| back[((back.len() - 1) as f64 * part) as usize];
    println!(
        "{dives} dives; back after frames: median {}, 99 % {}, most {}",
        at(0.5),
        at(0.99),
        at(1.0)
    );
}

#[test]
fn no_wrong_picture_is_shown_and_both_ends_always_come_back() {
    dives(&stub::Stub, "DIVES", 300);
}

#[test]
fn the_same_with_the_device() {
    dives(&device::Device::new(), "DEVICE_DIVES", 3);
}

/// Its numbers are those of frames that were decoded before.
#[test]
fn a_vehicle_that_begins_anew_with_the_same_numbers_is_shown() {
    let mut dive = Dive::new(&stub::Stub, 1);
    dive.weather = Weather {
        mtu: 64,
        protection: Protection::Layers,
        pacing: Pacing::Rate(12_000.0),
        stream: true,
        keys: false,
        in_order: false,
        loss: 0.0,
        way: [0.05, 0.0],
        ..dive.weather
    };
    dive.calm = true;
    dive.restart_topside();
    for _ in 0..2 {
        dive.states = [Vec::new(), Vec::new()];
        dive.restart_vehicle();
        let before = dive.shown.len();
        (0..12).for_each(|_| dive.step());
        let shown = dive.shown.len() - before;
        assert!(shown >= 8, "{shown} pictures");
        dive.time += 6.0;
    }
}
