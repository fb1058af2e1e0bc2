//! Modem frames to pictures.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use nvsprior::keys::{Keys, Seen};
use nvsprior::modem::{Collected, Collector, CollectorOptions, CollectorStatistics, ModemError};
use nvsprior::render::Scene;
use nvsprior::{Camera, Decoded, Decoder, Engine, Error, Trust};
use nvsprior_link::age_limit::AgeLimit;
use nvsprior_link::exposure::{self, ClockSource};
use nvsprior_link::pilot::PilotMessage;

use super::missing::Refusal;

/// Packets that are held.
const PACKETS: usize = 64;
/// Modem frames of a packet that there is room for.
const SHARES: usize = 256;
/// Seconds after which a packet is stale.
const STALE: f64 = 4.0;
/// A reference is one of so many frames before.
const FARTHEST: u32 = 32;
/// Most pixels of a picture.
const PIXELS: u32 = 1 << 22;

/// The picture that is shown.
pub struct Shown {
    pub decoded: Decoded,
    pub camera: Camera,
    /// Counts pictures.
    pub number: u64,
    /// When the modem frame came after which it was decoded, UTC.
    pub arrived: f64,
    /// When its frame was exposed, UTC; without a clock when its packet began to come.
    pub exposed: f64,
    pub clock: Option<ClockSource>,
    /// From which age on it is old, seconds.
    pub old: f64,
    /// Modem frames of its packet that came, and that were sent.
    pub shares: (usize, Option<usize>),
    /// Bytes of its packet that came.
    pub bytes: usize,
    pub complete: bool,
}

/// What a modem frame is worth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Worth {
    /// It is none, or of no use.
    Garbage,
    /// It is kept; others are to tell whether its packet is one.
    Unproven,
    /// Checks vouch for its packet.
    Proven,
}

pub struct Pictures {
    collector: Collector,
    decoder: Decoder,
    /// Of packets that are held: when they began to come.
    began: BTreeMap<u32, f64>,
    /// Packets of which more has come than was decoded.
    grown: BTreeSet<u32>,
    /// Frames are predicted from others.
    is_stream: bool,
    /// Whole packets of a stream, that later ones may be predicted from, or whose own references are missing yet.
    waiting: BTreeSet<u32>,
    /// Frames that were decoded in full.
    kept: BTreeSet<u32>,
    ahead: Decoded,
    shown: Option<Shown>,
    newest_time: f64,
    lacks_camera: bool,
    /// Of no whole packet all could be shown yet: a stream may go on from frames that a run before has seen.
    is_anew: bool,
    refusal: Option<Refusal>,
    mtu: usize,
}

impl Pictures {
    /// `filter`: pictures go through the display filter. `keys`: those of the vehicle.
    pub fn new(
        engine: &Engine,
        scene: &Arc<Scene>,
        mtu: usize,
        filter: bool,
        keys: Option<&Keys>,
    ) -> anyhow::Result<Pictures> {
        let options = CollectorOptions {
            packets: PACKETS,
            shares: SHARES,
            age: STALE,
            ..CollectorOptions::new(mtu)
        };
        let mut decoder = Decoder::new(engine, scene);
        decoder.set_pixel_limit(PIXELS);
        decoder.set_filter(filter)?;
        Ok(Pictures {
            collector: match keys {
                Some(keys) => Collector::with_keys(options, keys)?,
                None => Collector::new(options)?,
            },
            decoder,
            began: BTreeMap::new(),
            grown: BTreeSet::new(),
            is_stream: false,
            waiting: BTreeSet::new(),
            kept: BTreeSet::new(),
            ahead: Decoded::default(),
            shown: None,
            newest_time: 0.0,
            lacks_camera: false,
            is_anew: true,
            refusal: None,
            mtu,
        })
    }

    pub fn shown(&self) -> Option<&Shown> {
        self.shown.as_ref()
    }

    pub fn statistics(&self) -> CollectorStatistics {
        self.collector.statistics()
    }

    /// With keys: the number of the next report.
    pub fn next_number(&self) -> Option<u64> {
        self.collector.next_number()
    }

    /// With keys: the modem frames that were taken.
    pub fn seen(&self) -> impl Iterator<Item = Seen> + '_ {
        self.collector.seen()
    }

    /// Packets come, and what they are about, or predicted from, is not known: the vehicle must tell.
    pub fn lacks_start(&self) -> bool {
        self.lacks_camera || self.is_anew
    }

    /// Why packets that come are not shown.
    pub fn refusal(&self) -> Option<&Refusal> {
        self.refusal.as_ref()
    }

    /// The vehicle's camera, if it is known.
    pub fn camera(&self) -> Option<&Camera> {
        self.decoder.camera()
    }

    /// The vehicle's camera, as it was before a restart.
    pub fn add_camera(&mut self, camera: &Camera) -> Result<(), Error> {
        self.decoder.add_camera(camera)
    }

    /// Takes a modem frame that came at a time, UTC.
    pub fn take(&mut self, time: f64, bytes: &[u8]) -> Worth {
        self.newest_time = self.newest_time.max(time);
        match self.collector.push(self.newest_time, bytes) {
            Ok(Collected::Grown(_, frame)) => self.note(frame, false),
            Ok(Collected::Complete(_, frame)) => self.note(frame, true),
            Ok(Collected::Kept) => return Worth::Unproven,
            Ok(_) => {}
            Err(_) => return Worth::Garbage,
        }
        Worth::Proven
    }

    fn note(&mut self, frame: u32, is_whole: bool) {
        self.began.entry(frame).or_insert(self.newest_time);
        while self.began.len() > PACKETS {
            self.began.pop_first();
        }
        self.grown.insert(frame);
        if let Some(packet) = self.collector.packet(0, frame) {
            // If it cannot be read, it is not held, and the vehicle is told.
            let _ = self.decoder.hold(packet.bytes);
        }
        if is_whole && self.is_stream {
            self.waiting.insert(frame);
        }
    }

    /// Decodes what has come. `true`: there is another picture to show.
    ///
    /// # Errors
    /// If the device fails. Packets that cannot be decoded are no failure: [`Pictures::refusal`] tells.
    pub fn decode(&mut self) -> Result<bool, Error> {
        let grown = std::mem::take(&mut self.grown);
        let mut frames = std::mem::take(&mut self.waiting);
        frames.extend(grown.last());
        let mut is_new = self.decode_frames(&frames)?;
        if self.lacks_camera && grown.len() > 1 {
            // An earlier one tells the camera.
            is_new |= self.decode_frames(&grown)?;
        }
        Ok(is_new)
    }

    fn decode_frames(&mut self, frames: &BTreeSet<u32>) -> Result<bool, Error> {
        let mut is_new = false;
        for frame in frames {
            if !self.kept.contains(frame) {
                is_new |= self.decode_frame(*frame)?;
            }
        }
        Ok(is_new)
    }

    fn decode_frame(&mut self, frame: u32) -> Result<bool, Error> {
        let Some(packet) = self.collector.packet(0, frame) else { return Ok(false) };
        let decoded = self.decoder.decode_into(packet.bytes, Trust::Start, &mut self.ahead);
        if let Err(error) = decoded {
            return self.refuse(error);
        }
        (self.lacks_camera, self.refusal) = (false, None);
        self.is_anew &= !packet.complete || self.ahead.damage.is_some();
        let frame = self.ahead.frame;
        self.is_stream |= self.ahead.kept || self.ahead.reference.is_some();
        if self.ahead.kept {
            self.kept.insert(frame);
            while self.kept.len() > PACKETS {
                self.kept.pop_first();
            }
        } else if self.is_stream && packet.complete && !self.is_past(frame) {
            self.waiting.insert(frame);
        }
        if self.is_superseded(frame) {
            return Ok(false);
        }
        let age = packet.user.and_then(|user| exposure::age(user, self.newest_time));
        let old = packet.user.map_or(AgeLimit::UNTOLD.seconds(), exposure::limit);
        let began = self.began.get(&frame).copied().unwrap_or(self.newest_time);
        let Some(camera) = self.decoder.camera().copied() else { return Ok(false) };
        // The buffers of the picture before are used again.
        let before = self.shown.take().map(|shown| (shown.number, shown.decoded));
        let (number, spare) = before.unwrap_or_default();
        self.shown = Some(Shown {
            decoded: std::mem::replace(&mut self.ahead, spare),
            camera,
            number: number + 1,
            arrived: self.newest_time,
            exposed: age.map_or(began, |(age, _)| self.newest_time - age),
            clock: age.map(|(_, source)| source),
            old,
            shares: (packet.arrived, packet.sent),
            bytes: packet.bytes.len(),
            complete: packet.complete,
        });
        Ok(true)
    }

    /// No reference of a frame will come any more.
    fn is_past(&self, frame: u32) -> bool {
        self.shown.as_ref().is_some_and(|shown| frame + FARTHEST < shown.decoded.frame)
    }

    /// A later frame is shown. If that one came long ago, the vehicle has begun anew.
    fn is_superseded(&self, frame: u32) -> bool {
        self.shown.as_ref().is_some_and(|shown| {
            frame < shown.decoded.frame && self.newest_time - shown.arrived < STALE
        })
    }

    fn refuse(&mut self, error: Error) -> Result<bool, Error> {
        if matches!(error, Error::Vulkan(_)) {
            return Err(error);
        }
        self.lacks_camera |=
            matches!(error, Error::SessionUnknown { .. } | Error::Estranged { .. });
        self.refusal = Some(Refusal::from(&error));
        Ok(false)
    }

    /// What the vehicle is told, as a modem frame; `None`: nothing has come.
    pub fn report(&mut self, message: &PilotMessage) -> Option<Vec<u8>> {
        let kept = |frame| self.kept.contains(&frame);
        let mut report = self.collector.report(0, kept).ok()??;
        report.tell_poses(|frame| self.decoder.holds_pose(frame));
        let mut bytes = vec![0; self.mtu];
        let user = message.write();
        let written = match self.collector.write_report(&report, Some(&user), &mut bytes) {
            // A small modem frame has no room for the pilot's message.
            Err(ModemError::ReportMtu { .. }) => {
                self.collector.write_report(&report, None, &mut bytes)
            }
            written => written,
        };
        bytes.truncate(written.ok()?);
        Some(bytes)
    }
}

#[cfg(test)]
pub(super) mod tests;
