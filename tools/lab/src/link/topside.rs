//! The topside: shares to pictures, and reports of what came.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use nvsprior::modem::{Collected, Collector, CollectorOptions};
use nvsprior::packet::PacketError;
use nvsprior::render::Scene;
use nvsprior::{Camera, Decoded, Decoder, Engine, Error, Mode, Picture, Pose, Trust};

use super::Setting;

/// What the pilot sees of a camera frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shown {
    /// What came of its own packet.
    Own,
    /// The prior at a pose between those of frames that came.
    Between,
    /// The picture of this earlier frame.
    Held(u32),
    Nothing,
}

impl Shown {
    pub fn name(self) -> &'static str {
        match self {
            Shown::Own => "own",
            Shown::Between => "between",
            Shown::Held(_) => "held",
            Shown::Nothing => "nothing",
        }
    }
}

pub struct Topside {
    decoder: Decoder,
    collector: Collector,
    decoded: Decoded,
    /// The frame that `decoded` shows.
    shown: Option<u32>,
    size: (u32, u32),
    /// Frames on either side of one that did not come, between which its pose is looked for.
    reach: u32,
    /// By packet: when its first picture could be shown, and when all of it, seconds.
    pub pictures: BTreeMap<u32, (f64, Option<f64>)>,
    newest: Option<u32>,
    mtu: usize,
    /// Whether there are inter frames.
    inter: bool,
    /// Frames whose packets are whole, and whose references are missing.
    waiting: BTreeSet<u32>,
    /// Frames that were decoded in full.
    kept: BTreeSet<u32>,
    /// What is decoded before it is shown.
    ahead: Decoded,
    /// Pictures that were, until they are shown.
    ready: BTreeMap<u32, Picture>,
}

const PACKETS: usize = 64;
/// Seconds on either side of a frame that did not come, between which its pose is looked for: at least so many, and as
/// many as lie between two pictures of a slow link.
const REACH: f64 = 1.0;
/// A packet may take longer than its fewest bytes do, by so much.
const SLOWER: f64 = 1.5;
/// Camera frames after which a packet is stale at the latest: shares name frames modulo 256.
const STALE: f64 = 120.0;
/// A reference is one of so many frames before.
const FARTHEST: u32 = 32;

impl Topside {
    /// `cameras`: those of all packets, the first one's first.
    pub fn new<'c>(
        engine: &Engine,
        scene: &Arc<Scene>,
        cameras: impl Iterator<Item = &'c Camera>,
        setting: &Setting,
    ) -> anyhow::Result<Topside> {
        let mut decoder = Decoder::new(engine, scene);
        let mut size = (0, 0);
        for camera in cameras {
            decoder.add_camera(camera)?;
            if size == (0, 0) {
                size = (camera.width, camera.height);
            }
        }
        let reach = REACH.max(SLOWER * 8.0 * setting.min_bytes as f64 / setting.bit_rate);
        let options = CollectorOptions {
            shares: setting.shares,
            packets: PACKETS,
            age: (setting.latency + 2.0 * reach).min(STALE / setting.fps),
            ..CollectorOptions::new(setting.mtu)
        };
        Ok(Topside {
            decoder,
            collector: match &setting.keys {
                Some(keys) => Collector::with_keys(options, keys)?,
                None => Collector::new(options)?,
            },
            decoded: Decoded::default(),
            shown: None,
            size,
            reach: ((reach * setting.fps) as u32).clamp(1, PACKETS as u32 / 2 - 1),
            pictures: BTreeMap::new(),
            newest: None,
            mtu: setting.mtu,
            inter: setting.mode != Mode::Intra,
            waiting: BTreeSet::new(),
            kept: BTreeSet::new(),
            ahead: Decoded::default(),
            ready: BTreeMap::new(),
        })
    }

    /// Takes a modem frame that arrived at `now`.
    pub fn take(&mut self, now: f64, frame: &[u8]) -> anyhow::Result<()> {
        match self.collector.push(now, frame)? {
            Collected::Grown(_, number) => {
                self.hold(number);
                self.pictures.entry(number).or_insert((now, None));
                self.newest = self.newest.max(Some(number));
            }
            Collected::Complete(_, number) => {
                self.hold(number);
                self.pictures.entry(number).or_insert((now, None)).1 = Some(now);
                self.newest = self.newest.max(Some(number));
                if self.inter {
                    self.waiting.insert(number);
                    self.catch_up()?;
                }
            }
            Collected::Kept
            | Collected::Duplicate
            | Collected::Surplus
            | Collected::Damaged(..) => {}
        }
        Ok(())
    }

    /// Holds the pose of a packet as soon as it comes: later ones are predicted from it.
    fn hold(&mut self, number: u32) {
        if let Some(packet) = self.collector.packet(0, number) {
            // If it cannot be read, it is not held, and the vehicle is told.
            let _ = self.decoder.hold(packet.bytes);
        }
    }

    /// What there is of a camera frame.
    pub fn show(&mut self, frame: u32) -> anyhow::Result<(Shown, &Picture)> {
        let shown = self.look(frame)?;
        if self.shown.is_none() {
            self.decoded.picture.resize(self.size.0, self.size.1);
            self.decoded.picture.data.fill(128);
        }
        Ok((shown, &self.decoded.picture))
    }

    fn look(&mut self, frame: u32) -> anyhow::Result<Shown> {
        self.ready = self.ready.split_off(&frame);
        if let Some(picture) = self.ready.remove(&frame) {
            (self.decoded.picture, self.shown) = (picture, Some(frame));
            return Ok(Shown::Own);
        }
        if let Some(packet) = self.collector.packet(0, frame) {
            match self.decoder.decode_into(packet.bytes, Trust::Start, &mut self.decoded) {
                Err(Error::Packet(PacketError::PoseNotHeld { .. })) => return Ok(self.held()),
                decoded => decoded?,
            }
            self.shown = Some(frame);
            return Ok(Shown::Own);
        }
        let Some(pose) = self.pose_between(frame)? else {
            return Ok(self.held());
        };
        if !self.decoder.draw(&pose, &mut self.decoded.picture)? {
            return Ok(Shown::Nothing);
        }
        self.shown = Some(frame);
        Ok(Shown::Between)
    }

    /// The picture that is there already.
    fn held(&self) -> Shown {
        self.shown.map_or(Shown::Nothing, Shown::Held)
    }

    /// The pose of a frame that did not come, between those of frames that did and of which the vehicle is certain.
    fn pose_between(&self, frame: u32) -> anyhow::Result<Option<Pose>> {
        let pose = |number: u32| -> anyhow::Result<Option<(u32, Pose)>> {
            let Some(packet) = self.collector.packet(0, number) else { return Ok(None) };
            let (pose, certain) = match self.decoder.pose_of(packet.bytes) {
                Err(Error::Packet(PacketError::PoseNotHeld { .. })) => return Ok(None),
                told => told?,
            };
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
            held(*number)
                .is_some_and(|packet| packet.complete && Some(packet.arrived) < packet.sent)
        });
        self.collector.statistics().repaired + repaired.count() as u64
    }

    /// Decodes the packets that are whole, as soon as their references are there: they are references of others. A
    /// packet that came whole after its frame was shown still serves.
    fn catch_up(&mut self) -> anyhow::Result<()> {
        let mut done = true;
        while done {
            done = false;
            for frame in std::mem::take(&mut self.waiting) {
                let Some(packet) = self.collector.packet(0, frame) else { continue };
                match self.decoder.decode_into(packet.bytes, Trust::Start, &mut self.ahead) {
                    Err(Error::Packet(PacketError::PoseNotHeld { .. })) => self.ahead.kept = false,
                    decoded => decoded?,
                }
                if self.ahead.kept {
                    self.kept.insert(frame);
                    self.ready.insert(frame, self.ahead.picture.clone());
                    done = true;
                } else if self.newest.is_some_and(|newest| frame + FARTHEST > newest) {
                    self.waiting.insert(frame);
                }
            }
        }
        Ok(())
    }

    /// What the vehicle is to know, as it goes over the return channel.
    pub fn report(&mut self) -> anyhow::Result<Option<Vec<u8>>> {
        let kept = |frame| self.kept.contains(&frame);
        let Some(mut report) = self.collector.report(0, kept)? else { return Ok(None) };
        report.tell_poses(|frame| self.decoder.holds_pose(frame));
        let mut bytes = vec![0; self.mtu];
        let len = self.collector.write_report(&report, None, &mut bytes)?;
        bytes.truncate(len);
        Ok(Some(bytes))
    }
}
