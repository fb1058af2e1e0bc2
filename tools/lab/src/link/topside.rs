//! The topside: shares to pictures, and reports of what came.

use std::collections::BTreeMap;
use std::sync::Arc;

use nvsprior::modem::{Collected, Collector, CollectorOptions};
use nvsprior::render::Scene;
use nvsprior::{Camera, Decoded, Decoder, Engine, Picture, Pose, Trust};

use super::Setting;

/// What the topside tells the vehicle.
#[derive(Clone, Debug)]
pub struct TopsideReport {
    /// Shares lost since the report before, as a part of all; `None`: too few to tell.
    pub loss: Option<f64>,
    /// When it was made, seconds.
    pub time: f64,
    /// Indices of the shares that came of recent packets that are not whole.
    short: BTreeMap<u32, Vec<usize>>,
}

impl TopsideReport {
    /// Indices of a packet's shares that came; `None` if it is whole, or not a recent one.
    pub fn short_of(&self, number: u32) -> Option<&[usize]> {
        self.short.get(&number).map(Vec::as_slice)
    }

    /// Its bytes on the link: a header, and for each packet a number and which shares came.
    pub fn len(&self) -> usize {
        8 + 4 * self.short.len()
    }
}

/// What the pilot sees of a camera frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Seen {
    /// What came of its own packet.
    Own,
    /// The prior at a pose between those of frames that came.
    Between,
    /// The picture of this earlier frame.
    Held(u32),
    /// Nothing has come yet.
    Nothing,
}

impl Seen {
    pub fn name(self) -> &'static str {
        match self {
            Seen::Own => "own",
            Seen::Between => "between",
            Seen::Held(_) => "held",
            Seen::Nothing => "nothing",
        }
    }
}

pub struct Topside {
    decoder: Decoder,
    collector: Collector,
    decoded: Decoded,
    /// The frame that `decoded` shows.
    seen: Option<u32>,
    size: (u32, u32),
    /// Frames on either side of one that did not come, between which its pose is looked for.
    reach: u32,
    /// By packet: when its first picture could be shown, and when all of it, seconds.
    pub pictures: BTreeMap<u32, (f64, Option<f64>)>,
    counted: (u64, u64),
    newest: Option<u32>,
}

/// Packets that are held.
const PACKETS: usize = 64;
/// Seconds on either side of a frame that did not come, between which its pose is looked for.
const REACH: f64 = 1.0;
/// Camera frames after which a packet is stale at the latest: shares name frames modulo 128.
const STALE: f64 = 60.0;
/// Packets before the newest that a report is about.
const REPORTED: u32 = 24;

impl Topside {
    pub fn new(
        engine: &Engine,
        scene: &Arc<Scene>,
        camera: &Camera,
        setting: &Setting,
    ) -> anyhow::Result<Topside> {
        let mut decoder = Decoder::new(engine, scene);
        decoder.add_camera(camera)?;
        let options = CollectorOptions {
            mtu: setting.mtu,
            shares: setting.shares,
            packets: PACKETS,
            streams: 1,
            age: (setting.latency + 2.0 * REACH).min(STALE / setting.fps),
        };
        Ok(Topside {
            decoder,
            collector: Collector::new(options)?,
            decoded: Decoded::default(),
            seen: None,
            size: (camera.width, camera.height),
            reach: ((REACH * setting.fps) as u32).clamp(1, PACKETS as u32 / 2 - 1),
            pictures: BTreeMap::new(),
            counted: (0, 0),
            newest: None,
        })
    }

    /// Takes a modem frame that arrived at `now`.
    pub fn take(&mut self, now: f64, frame: &[u8]) -> anyhow::Result<()> {
        match self.collector.push(now, frame)? {
            Collected::Grown(_, number) => {
                self.pictures.entry(number).or_insert((now, None));
                self.newest = self.newest.max(Some(number));
            }
            Collected::Complete(_, number) => {
                self.pictures.entry(number).or_insert((now, None)).1 = Some(now);
                self.newest = self.newest.max(Some(number));
            }
            Collected::Kept
            | Collected::Duplicate
            | Collected::Surplus
            | Collected::Damaged(..) => {}
        }
        Ok(())
    }

    /// What there is of a camera frame.
    pub fn show(&mut self, frame: u32) -> anyhow::Result<(Seen, &Picture)> {
        let seen = self.look(frame)?;
        if self.seen.is_none() {
            self.decoded.picture.resize(self.size.0, self.size.1);
            self.decoded.picture.data.fill(128);
        }
        Ok((seen, &self.decoded.picture))
    }

    fn look(&mut self, frame: u32) -> anyhow::Result<Seen> {
        if let Some(packet) = self.collector.packet(0, frame) {
            self.decoder.decode_into(packet.bytes, Trust::Start, &mut self.decoded)?;
            self.seen = Some(frame);
            return Ok(Seen::Own);
        }
        let Some(pose) = self.pose_between(frame)? else {
            return Ok(self.seen.map_or(Seen::Nothing, Seen::Held));
        };
        if !self.decoder.draw(&pose, &mut self.decoded.picture)? {
            return Ok(Seen::Nothing);
        }
        self.seen = Some(frame);
        Ok(Seen::Between)
    }

    /// The pose of a frame that did not come, between those of frames that did and of which the vehicle is certain.
    fn pose_between(&self, frame: u32) -> anyhow::Result<Option<Pose>> {
        let pose = |number: u32| -> anyhow::Result<Option<(u32, Pose)>> {
            let Some(packet) = self.collector.packet(0, number) else { return Ok(None) };
            let (pose, certain) = self.decoder.pose_of(packet.bytes)?;
            Ok(certain.then_some((number, pose)))
        };
        let first =
            |numbers: &mut dyn Iterator<Item = u32>| -> anyhow::Result<Option<(u32, Pose)>> {
                for number in numbers {
                    if let Some(found) = pose(number)? {
                        return Ok(Some(found));
                    }
                }
                Ok(None)
            };
        let before = first(&mut (1..=self.reach).map_while(|back| frame.checked_sub(back)))?;
        let after = first(&mut (1..=self.reach).map(|ahead| frame + ahead))?;
        let (Some((from, start)), Some((to, end))) = (before, after) else { return Ok(None) };
        let part = f64::from(frame - from) / f64::from(to - from);
        Ok(Some(start.between(&end, part)))
    }

    /// Packets so far that are whole although shares of them are missing.
    pub fn repaired(&self) -> u64 {
        let held = |number: u32| self.collector.packet(0, number);
        let newest = self.newest.unwrap_or(0);
        let recent = newest.saturating_sub(PACKETS as u32 - 1)..=newest;
        let repaired = recent.filter(|number| {
            held(*number).is_some_and(|packet| packet.complete && packet.arrived < packet.sent)
        });
        self.collector.statistics().repaired + repaired.count() as u64
    }

    /// What is told to the vehicle.
    pub fn report(&mut self, now: f64) -> TopsideReport {
        let statistics = self.collector.statistics();
        let (arrived, sent) =
            (statistics.arrived - self.counted.0, statistics.sent - self.counted.1);
        let loss = (sent >= 16).then(|| 1.0 - arrived as f64 / sent as f64);
        if loss.is_some() {
            self.counted = (statistics.arrived, statistics.sent);
        }
        let upto = self.newest.unwrap_or(0);
        let recent = upto.saturating_sub(REPORTED)..=upto;
        let whole = |number: &u32| self.collector.packet(0, *number).is_some_and(|p| p.complete);
        let short = recent.filter(|number| !whole(number));
        let short = short.map(|number| (number, self.collector.arrived(0, number).collect()));
        TopsideReport { loss, time: now, short: short.collect() }
    }
}
