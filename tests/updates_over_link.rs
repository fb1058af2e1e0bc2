//! Updates over a link that loses modem frames: vehicles and topsides restart, join late and forget. What is shown as
//! whole is what the vehicle saw, always, and both sides end on one version.

mod common;
mod scene;

use std::sync::Arc;

use common::{Random, assert_silent};
use nvsprior::modem::{
    Collector, CollectorOptions, Loss, Protection, RateControlOptions, Report, Sender,
    SenderOptions, UpdateOptions,
};
use nvsprior::packet::Latent;
use nvsprior::prior::{Learnt, NewSplat, Update, UpdateGrid};
use nvsprior::render::Scene;
use nvsprior::{Decoded, Decoder, Encoder, EncoderOptions, Engine, Picture, Prior, Rate, Trust};
use scene::{CAMERA, clean_frame, on_device, pose, wall};

/// Pictures per second.
const FPS: u32 = 4;
const MTU: usize = 64;
/// Updates of a chain: more than a topside holds states of.
const MOST: usize = 12;
/// Different frames; the run goes through them again and again.
const FRAMES: usize = 6;

fn update(learnt: &Learnt, seed: u64) -> Update {
    let number = learnt.number() + 1;
    let mut random = Random::new(seed * 1000 + u64::from(number));
    let mut within = |low: f32, high: f32| random.within(low, high) as i32;
    let mut ball = |_| NewSplat {
        position: [within(-40.0, 40.0), within(-20.0, 20.0), within(0.0, 10.0)],
        log_scale: [-6; 3],
        rotation: [0; 3],
        opacity: 6,
        colour: [0; 3].map(|_| within(-10.0, 10.0) as i8),
    };
    Update {
        prior: learnt.prior(),
        number,
        before: learnt.state(),
        grid: UpdateGrid { origin: [0.0, 0.0, 3.0], exponent: -4 },
        splats: (0..20).map(&mut ball).collect(),
        removed: if number > 1 { vec![0, 3] } else { vec![] },
        changed: vec![],
        fades: vec![],
        frames: [0, 1],
    }
}

fn bytes_of(update: &Update) -> Vec<u8> {
    let mut bytes = Vec::new();
    update.write(&mut bytes).unwrap();
    bytes
}

fn sender_options(loss: f64, expect_reports: bool) -> SenderOptions {
    let control = RateControlOptions {
        bit_rate: 16_000.0,
        mtu: MTU,
        overhead: 0,
        latency: 1.5,
        delay: 0.1,
        spread: 0.0,
        frame_rate: f64::from(FPS),
        min_bytes: 40,
        max_shares: 16,
        loss: Loss { chance: loss, burst: 1.0 },
        user: None,
    };
    let updates = Some(UpdateOptions::default());
    SenderOptions { control, stream: 0, protection: Protection::Layers, expect_reports, updates }
}

/// A vehicle, what it has learnt, and its frames.
struct Vehicle {
    encoder: Encoder,
    sender: Sender,
    options: SenderOptions,
    scene: Arc<Scene>,
    /// The state after each update of its chain, and the updates. It draws with the first `drawn` of them.
    chain: Vec<(Learnt, Vec<u8>)>,
    drawn: usize,
    seed: u64,
}

impl Vehicle {
    fn new(engine: &Engine, scene: &Arc<Scene>, options: SenderOptions) -> Vehicle {
        Vehicle {
            encoder: encoder(engine, scene, 0),
            sender: Sender::new(options).unwrap(),
            options,
            scene: scene.clone(),
            chain: Vec::new(),
            drawn: 0,
            seed: 1,
        }
    }

    /// Begins anew, with the first `kept` updates.
    fn restart(&mut self, engine: &Engine, now: f64, frame: u32, kept: usize) {
        self.encoder = encoder(engine, &self.scene, frame);
        self.sender = Sender::new(self.options).unwrap();
        self.chain.truncate(kept);
        self.drawn = 0;
        self.seed += 1;
        for (_, update) in &self.chain {
            self.sender.push_update(now, update).unwrap();
        }
    }

    /// Learns something, and sends it. It waits for the updates before, as a learner does.
    fn learn(&mut self, now: f64) {
        if self.drawn < self.chain.len() || self.chain.len() == MOST {
            return;
        }
        let mut learnt = match self.chain.last() {
            Some((learnt, _)) => learnt.clone(),
            None => Learnt::none(self.scene.id()),
        };
        let update = update(&learnt, self.seed);
        learnt.add(&update).unwrap();
        let bytes = bytes_of(&update);
        self.sender.push_update(now, &bytes).unwrap();
        self.chain.push((learnt, bytes));
    }

    /// Draws with what the topside holds.
    fn adopt(&mut self) {
        let held = usize::from(self.sender.held_update().unwrap_or(0));
        if held > self.drawn {
            self.encoder.set_learnt(&self.chain[held - 1].0).unwrap();
            self.drawn = held;
        }
    }
}

fn encoder(engine: &Engine, scene: &Arc<Scene>, first_frame: u32) -> Encoder {
    let options = EncoderOptions { first_frame, camera_interval: 16, ..EncoderOptions::default() };
    Encoder::new(engine, scene, &CAMERA, options).unwrap()
}

/// A topside, and what it has shown.
struct Topside {
    decoder: Decoder,
    collector: Collector,
    decoded: Decoded,
    /// What it has written down: the updates that came.
    updates: Vec<Vec<u8>>,
    whole: usize,
    outdated: usize,
}

impl Topside {
    fn new(engine: &Engine, scene: &Arc<Scene>) -> Topside {
        let options = CollectorOptions {
            packets: 64,
            update_bytes: 2000,
            age: 6.0,
            ..CollectorOptions::new(MTU)
        };
        let mut decoder = Decoder::new(engine, scene);
        decoder.add_camera(&CAMERA).unwrap();
        Topside {
            decoder,
            collector: Collector::new(options).unwrap(),
            decoded: Decoded::default(),
            updates: Vec::new(),
            whole: 0,
            outdated: 0,
        }
    }

    fn take(&mut self, now: f64, frame: &[u8]) {
        let _ = self.collector.push(now, frame);
        while let Some(update) = self.collector.update(0) {
            let added = self.decoder.add_update(update).is_ok();
            if added {
                self.updates.push(update.to_vec());
            }
            self.collector.settle_update(0, added);
        }
    }

    /// Shows a frame, if it came. `expected`: what the vehicle saw of it.
    fn show(&mut self, frame: u32, expected: &Picture, render: &Picture) {
        let Some(packet) = self.collector.packet(0, frame) else { return };
        let complete = packet.complete;
        self.decoder.decode_into(packet.bytes, Trust::Start, &mut self.decoded).unwrap();
        if self.decoded.missing_update.is_some() {
            self.outdated += 1;
            assert_eq!(self.decoded.rows, 0, "no difference on another render");
            return;
        }
        let whole = complete && self.decoded.damage.is_none();
        self.whole += usize::from(whole);
        // Of a part of the packet, the render is the vehicle's.
        let shown = &self.decoded.picture;
        assert!(!whole || shown == expected, "frame {frame}: another picture than the vehicle's");
        assert!(self.decoded.rows > 0 || shown == render, "frame {frame}: another render");
    }

    fn report(&self) -> Option<Vec<u8>> {
        let mut report = self.collector.report(0, |_| false).unwrap()?;
        report.tell_states(self.decoder.states());
        let mut bytes = vec![0; MTU];
        let len = report.write(None, &mut bytes).unwrap();
        bytes.truncate(len);
        Some(bytes)
    }
}

/// A dive, in steps of a frame.
struct Dive {
    engine: Engine,
    frames: Vec<Picture>,
    vehicle: Vehicle,
    topside: Topside,
    random: Random,
    loss: f32,
    tick: u32,
    /// Modem frames that are late.
    late: Vec<Vec<u8>>,
    /// Reports on their way.
    reports: Vec<(u32, Vec<u8>)>,
    /// Losses, restarts and joins.
    events: usize,
    has_frames: bool,
}

impl Dive {
    fn new(prior: &Prior, loss: f32, expect_reports: bool, seed: u64) -> Dive {
        let (engine, plain) = on_device(prior);
        let frame = |t| clean_frame(&engine, &plain, &pose(t as f64));
        let frames = (0..FRAMES).map(frame).collect();
        let scene = engine.upload_for_updates(prior).unwrap();
        let options = sender_options(f64::from(loss).max(0.1), expect_reports);
        Dive {
            frames,
            vehicle: Vehicle::new(&engine, &scene, options),
            topside: Topside::new(&engine, &scene),
            engine,
            random: Random::new(seed),
            loss,
            tick: 0,
            late: Vec::new(),
            reports: Vec::new(),
            events: 0,
            has_frames: true,
        }
    }

    fn chance(&mut self, chance: f32) -> bool {
        self.random.within(0.0, 1.0) < chance
    }

    fn step(&mut self) {
        let now = f64::from(self.tick) / f64::from(FPS);
        self.vehicle.adopt();
        let shown = if self.has_frames { self.encode(now) } else { None };
        for frame in std::mem::take(&mut self.late) {
            self.topside.take(now, &frame);
        }
        while let Some((_, frame)) = self.vehicle.sender.next(now) {
            let frame = frame.to_vec();
            if self.random.within(0.0, 1.0) < self.loss {
                self.events += 1;
            } else if self.random.within(0.0, 1.0) < 0.05 {
                self.late.push(frame);
            } else {
                self.topside.take(now, &frame);
            }
        }
        if let Some((number, expected, render)) = shown {
            self.topside.show(number, &expected, &render);
        }
        self.report(now);
        self.tick += 1;
    }

    /// Encodes the next frame. Its number, and what the topside is to show of it.
    fn encode(&mut self, now: f64) -> Option<(u32, Picture, Picture)> {
        let vehicle = &mut self.vehicle;
        let Some(bytes) = vehicle.sender.plan(now).unwrap() else {
            vehicle.encoder.skip(1);
            return None;
        };
        let bytes = bytes + vehicle.encoder.extra_bytes();
        vehicle.encoder.set_rate(Some(Rate::Bytes(bytes)));
        let t = self.tick as usize % (2 * FRAMES - 2);
        let t = if t < FRAMES { t } else { 2 * FRAMES - 2 - t };
        let encoded = vehicle.encoder.encode(&self.frames[t], Some(pose(t as f64))).unwrap();
        vehicle.sender.push(now, &encoded.packet, None).unwrap();
        Some((encoded.stats.frame, encoded.picture, encoded.render))
    }

    /// Once a second, and a second later at the vehicle. Some are lost.
    fn report(&mut self, now: f64) {
        if !self.vehicle.options.expect_reports {
            return;
        }
        if self.tick.is_multiple_of(FPS)
            && let Some(report) = self.topside.report()
            && !self.chance(0.2)
        {
            self.reports.push((self.tick + FPS, report));
        }
        while self.reports.first().is_some_and(|(tick, _)| *tick <= self.tick) {
            let (_, report) = self.reports.remove(0);
            let (report, _) = Report::read(&report).unwrap();
            self.vehicle.sender.process_report(now, &report).unwrap();
        }
    }

    /// Something restarts or is learnt, by chance.
    fn happen(&mut self) {
        let now = f64::from(self.tick) / f64::from(FPS);
        if self.chance(0.3) {
            self.vehicle.learn(now);
        }
        if self.chance(0.03) {
            let kept = self.random.within(0.0, 1.0 + self.vehicle.chain.len() as f32) as usize;
            self.vehicle.restart(&self.engine, now, self.tick, kept);
            self.events += 1;
        }
        if self.chance(0.08) {
            let new = Topside::new(&self.engine, &self.vehicle.scene);
            let old = std::mem::replace(&mut self.topside, new);
            (self.topside.whole, self.topside.outdated) = (old.whole, old.outdated);
            if self.chance(0.4) {
                for update in &old.updates {
                    let _ = self.topside.decoder.add_update(update);
                }
                self.topside.updates = old.updates;
            }
            self.events += 1;
        }
    }

    /// Both sides have all that the vehicle has learnt, and the topside shows the next frames.
    fn assert_one_version(&mut self, what: &str) {
        let (learnt, _) = self.vehicle.chain.last().unwrap();
        // The topside may hold more: what the vehicle forgot when it restarted, and has not learnt anew.
        let held = self.topside.decoder.states().any(|(_, state)| state == learnt.state());
        assert!(held, "{what}: {:?}", self.topside.decoder.states().collect::<Vec<_>>());
        assert_eq!(self.vehicle.encoder.learnt().state(), learnt.state(), "{what}");
    }

    /// Runs until there were so many events, and then for some seconds without any but losses.
    fn run(&mut self, events: usize, quiet: u32) {
        while self.events < events {
            self.happen();
            self.step();
        }
        let now = f64::from(self.tick) / f64::from(FPS);
        if self.vehicle.chain.is_empty() {
            self.vehicle.learn(now);
        }
        // Reports tell of frames. Without them, updates need none.
        self.has_frames = self.vehicle.options.expect_reports;
        (0..quiet * FPS).for_each(|_| self.step());
        self.has_frames = true;
        let outdated = self.topside.outdated;
        self.assert_one_version("after quiet seconds");
        self.loss = 0.0;
        (0..4 * FPS).for_each(|_| self.step());
        assert_eq!(self.topside.outdated, outdated, "no frame with an older version any more");
    }
}

#[test]
fn five_hundred_losses_and_restarts_with_reports_end_on_one_version() {
    let prior = wall(41);
    let mut dive = Dive::new(&prior, 0.2, true, 41);
    dive.run(500, 30);
    let (whole, outdated) = (dive.topside.whole, dive.topside.outdated);
    assert!(whole > 100 && outdated > 10, "{whole} whole, {outdated} outdated");
    assert_silent(&dive.engine);
}

#[test]
fn five_hundred_losses_and_restarts_without_reports_end_on_one_version() {
    let prior = wall(42);
    let mut dive = Dive::new(&prior, 0.2, false, 42);
    dive.run(500, 240);
    let (whole, outdated) = (dive.topside.whole, dive.topside.outdated);
    assert!(whole > 100 && outdated > 10, "{whole} whole, {outdated} outdated");
    assert_silent(&dive.engine);
}

/// Nothing is adopted before the topside holds it: without restarts, no frame is ever shown with an older version.
#[test]
fn with_reports_no_frame_is_drawn_with_what_the_topside_lacks() {
    let prior = wall(43);
    let mut dive = Dive::new(&prior, 0.2, true, 43);
    let mut names = 0;
    for step in 0..160 {
        if step % 40 == 10 {
            dive.vehicle.learn(f64::from(dive.tick) / f64::from(FPS));
        }
        dive.step();
        let drawn = dive.vehicle.encoder.learnt().number();
        assert!(drawn <= dive.topside.decoder.learnt().number());
        names += u32::from(drawn > 0);
    }
    dive.assert_one_version("after the dive");
    assert_eq!((dive.topside.outdated, dive.vehicle.drawn), (0, 4));
    assert!(names > 100 && dive.topside.whole > 60, "{names} {}", dive.topside.whole);
}

/// A vehicle that has forgotten all begins anew at update 1: the topside takes the new chain beside the old one, and
/// shows no frame of one chain by the other.
#[test]
fn a_new_chain_is_taken_beside_the_old_one() {
    let prior = wall(44);
    let mut dive = Dive::new(&prior, 0.0, true, 44);
    let quiet = |dive: &mut Dive| (0..10 * FPS).for_each(|_| dive.step());
    for _ in 0..3 {
        dive.vehicle.learn(f64::from(dive.tick) / f64::from(FPS));
        quiet(&mut dive);
    }
    let old = dive.topside.decoder.learnt().state();
    assert_eq!((dive.vehicle.drawn, dive.topside.outdated), (3, 0));
    dive.vehicle.restart(&dive.engine, f64::from(dive.tick) / f64::from(FPS), dive.tick, 0);
    quiet(&mut dive);
    assert_eq!(dive.topside.decoder.learnt().state(), old, "nothing new was learnt");
    let whole = dive.topside.whole;
    dive.vehicle.learn(f64::from(dive.tick) / f64::from(FPS));
    quiet(&mut dive);
    dive.assert_one_version("the new chain");
    assert_eq!((dive.topside.decoder.learnt().number(), dive.topside.outdated), (1, 0));
    assert!(dive.topside.whole > whole + 20);
    let latent = Latent::decode(&dive.vehicle.encoder_packet()).unwrap();
    assert_eq!(latent.update, Some(1));
}

impl Vehicle {
    /// A packet of a frame that is not sent.
    fn encoder_packet(&mut self) -> Vec<u8> {
        let frame = Picture::new(CAMERA.width, CAMERA.height);
        self.encoder.encode(&frame, Some(pose(0.0))).unwrap().packet
    }
}
