//! The topside's end without pixels: modem frames in, packets out; reports out.

use crate::keys::Keys;
use crate::modem::{
    Collected, CollectedPacket, Collector, CollectorStatistics, ModemError, Report,
};
use nvsprior::Camera;

use super::age_limit::AgeLimit;
use super::error::LinkError;
use super::event::{Events, TopsideEvent};
use super::exposure::{self, ClockSource};
use super::frame_set::FrameSet;
use super::options::{Playout, TopsideOptions};
use super::pilot::{PilotMessage, Region};
use super::playout::{Due, Schedule, number_of};
use super::stored::{Keeper, MAX_STATE, Position, Side, Stored};
use super::timeline::Timeline;

/// A packet whose turn it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DuePacket {
    /// Frame number, counted on beyond 2¹⁶.
    pub frame: i64,
    /// The frame's time, by the caller's clock, seconds.
    pub time: f64,
    /// It does not follow the one before: the vehicle counts anew, or its clock does.
    pub restarted: bool,
}

/// What a modem frame was worth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Worth {
    /// It is kept; others are to tell whether its packet is one.
    Unproven,
    /// Checks vouch for its packet.
    Proven,
}

/// The topside's end for who decodes himself, or on another machine.
///
/// Give it what the modem received; take packets, reports and events. [`Topside`](super::Topside) also decodes.
/// Nothing is allocated after [`new`](Self::new).
pub struct TopsideLink {
    collector: Collector,
    stream: u8,
    playout: Playout,
    schedule: Option<Schedule>,
    /// Packets of which more has come than was handed out.
    grown: FrameSet,
    timeline: Timeline,
    is_utc: bool,
    report_every: Option<f64>,
    /// When the last report was made, seconds.
    reported: f64,
    /// When something of the vehicle came last.
    heard: Option<f64>,
    is_silent: bool,
    /// What came that could not be read, since nothing of the vehicle comes.
    strangers: u64,
    region: Option<Region>,
    has_stamps: bool,
    /// User bytes of reports.
    user: Vec<u8>,
    message: Vec<u8>,
    report: Vec<u8>,
    /// The camera that the state told, until another is known.
    camera: Option<Camera>,
    keeper: Keeper,
    events: Events<TopsideEvent>,
}

/// Seconds of silence after which the vehicle counts as away.
const AWAY: f64 = 30.0;
/// Seconds of silence after which no reports are made any more.
const PATIENCE: f64 = 60.0;
/// What comes and cannot be read, while nothing of the vehicle comes, after which something must be wrong.
const STRANGERS: u64 = 20;
const MOST_USER: usize = 255;
const PACKETS: usize = 64;

impl TopsideLink {
    /// Takes all its memory here: [`TopsideLink::memory`].
    ///
    /// # Errors
    /// With the option that is outside its range, and what it allows. If the state is not a topside's, or of a later
    /// epoch. If the system does not have the memory.
    pub fn new(options: &TopsideOptions) -> Result<TopsideLink, LinkError> {
        let stored = match options.state.as_slice() {
            [] => Stored::default(),
            state => Stored::read(Side::Topside, state)?,
        };
        let keys = options.keys.as_ref().map(|keys| stored.resumed(keys)).transpose()?;
        let collector = options.collector()?;
        let camera = stored.camera;
        let stored = Stored { epoch: keys.as_ref().map_or(0, Keys::epoch), ..stored };
        let mut events = Events::new();
        // Before anything goes.
        events.tell(keys.is_some().then_some(TopsideEvent::Store));
        Ok(TopsideLink {
            stream: options.stream,
            playout: options.playout,
            schedule: match options.playout {
                Playout::InOrder { latency, frame_rate } => {
                    Some(Schedule::new(latency, frame_rate))
                }
                Playout::Newest | Playout::OnDemand => None,
            },
            grown: FrameSet::with_room(PACKETS),
            timeline: Timeline::default(),
            is_utc: options.is_utc,
            report_every: options.report_every,
            reported: f64::NEG_INFINITY,
            heard: None,
            is_silent: false,
            strangers: 0,
            region: None,
            has_stamps: false,
            user: Vec::with_capacity(MOST_USER),
            message: Vec::with_capacity(MOST_USER),
            report: vec![0; options.mtu],
            camera,
            keeper: Keeper::new(Side::Topside, stored),
            events,
            collector: match &keys {
                Some(keys) => Collector::with_keys(collector, keys)?,
                None => Collector::new(collector)?,
            },
        })
    }

    /// Memory that it takes, bytes.
    ///
    /// # Errors
    /// With the option that is outside its range.
    pub fn memory(options: &TopsideOptions) -> Result<usize, LinkError> {
        let collector = options.collector()?;
        let memory = match &options.keys {
            Some(keys) => collector.memory_with_keys(keys)?,
            None => collector.memory()?,
        };
        /// Lists of fixed length.
        const OTHERS: usize = 4 << 10;
        Ok(memory + options.mtu + OTHERS)
    }

    /// Takes what the modem received. Modem frames may come in any order, repeated, padded or damaged, and mixed with
    /// others. Tells what it was worth, and the frame whose packet has more bytes, or is whole (`true`).
    ///
    /// # Errors
    /// If it is none of the vehicle's, damaged, or too late. That is no failure of the link.
    pub fn receive(
        &mut self,
        now: f64,
        bytes: &[u8],
    ) -> Result<(Worth, Option<(u32, bool)>), LinkError> {
        let now = self.timeline.at(now)?;
        self.watch(now);
        let collected = match self.collector.push(now, bytes) {
            Ok(collected) => collected,
            Err(error) => {
                self.note_stranger();
                return Err(error.into());
            }
        };
        let own = |stream| stream == self.stream;
        let grown = match collected {
            Collected::Kept => {
                self.note(now, None);
                return Ok((Worth::Unproven, None));
            }
            Collected::Grown(stream, frame) if own(stream) => Some((frame, false)),
            Collected::Complete(stream, frame) if own(stream) => Some((frame, true)),
            Collected::Grown(..)
            | Collected::Complete(..)
            | Collected::Duplicate
            | Collected::Surplus
            | Collected::Damaged(..) => None,
        };
        if self.heard.is_none() || self.is_silent {
            self.events.tell(TopsideEvent::VehicleHeard);
        }
        (self.heard, self.is_silent, self.strangers) = (Some(now), false, 0);
        self.note(now, grown);
        Ok((Worth::Proven, grown))
    }

    /// Notes a modem frame of the vehicle.
    fn note(&mut self, now: f64, grown: Option<(u32, bool)>) {
        if let Some(schedule) = &mut self.schedule {
            schedule.note(now, grown, (&self.collector, self.stream));
        }
        if let Some((frame, _)) = grown {
            self.grown.insert(frame);
            self.has_stamps |= self.packet(frame).is_some_and(|packet| packet.user.is_some());
        }
    }

    /// The next packet for who decodes elsewhere. In order: the next frame's, once it is whole or its time is over; it
    /// may be the start of one. Newest: the newest one of which more has come. `None`: none now.
    ///
    /// # Errors
    /// If the time is not finite.
    pub fn next_packet(
        &mut self,
        now: f64,
    ) -> Result<Option<(DuePacket, CollectedPacket<'_>)>, LinkError> {
        let now = self.timeline.at(now)?;
        let due = match self.playout {
            Playout::InOrder { .. } => self.next_due(now),
            Playout::Newest | Playout::OnDemand => {
                let newest = self.grown.iter().max();
                self.grown.clear();
                newest.map(|frame| Due { frame: frame.into(), time: now, restarted: false })
            }
        };
        let Some(Due { frame, time, restarted }) = due else { return Ok(None) };
        let time = self.timeline.told(time);
        let packet = self.packet(number_of(frame));
        Ok(packet.map(|packet| (DuePacket { frame, time, restarted }, packet)))
    }

    /// The next frame whose turn it is.
    pub(super) fn next_due(&mut self, now: f64) -> Option<Due> {
        let (collector, stream) = (&self.collector, self.stream);
        let has_picture = |frame| collector.packet(stream, frame).is_some();
        self.schedule.as_mut()?.next(now, has_picture)
    }

    /// Frames of whose packets more has come: gives each to `take`.
    pub(super) fn take_grown(&mut self, mut take: impl FnMut(u32)) {
        self.grown.iter().for_each(&mut take);
        self.grown.clear();
    }

    /// With [`Playout::InOrder`]: when the next frame goes on at the latest.
    fn deadline(&self) -> Option<f64> {
        self.schedule.as_ref()?.deadline()
    }

    /// With [`Playout::InOrder`]: when the next frame goes on at the latest, by the caller's clock, seconds.
    pub fn picture_due(&self) -> Option<f64> {
        Some(self.timeline.told(self.deadline()?))
    }

    /// Sets how long packets wait for their rest from here on, with [`Playout::InOrder`]; seconds.
    pub fn set_latency(&mut self, latency: f64) {
        if let Some(schedule) = &mut self.schedule {
            schedule.set_latency(latency);
        }
    }

    /// With [`Playout::InOrder`]: packets that came only after a later one had gone on, or after their time.
    pub fn late(&self) -> u64 {
        self.schedule.as_ref().map_or(0, Schedule::late)
    }

    fn note_stranger(&mut self) {
        if self.heard.is_some() && !self.is_silent {
            return;
        }
        self.strangers += 1;
        if self.strangers == STRANGERS {
            self.events.tell(TopsideEvent::Strangers(STRANGERS));
        }
    }

    /// The time of a call, such that times do not go back.
    ///
    /// # Errors
    /// If it is not finite.
    #[doc(hidden)]
    pub fn at(&mut self, now: f64) -> Result<f64, ModemError> {
        self.timeline.at(now)
    }

    /// The time of the last call.
    #[doc(hidden)]
    pub fn last(&self) -> f64 {
        self.timeline.last()
    }

    /// A time by the caller's clock.
    #[doc(hidden)]
    pub fn told(&self, time: f64) -> f64 {
        self.timeline.told(time)
    }

    /// Looks what there is to tell.
    fn watch(&mut self, now: f64) {
        if let Some(silence) = self.silence(now)
            && silence >= AWAY
            && !std::mem::replace(&mut self.is_silent, true)
        {
            self.events.tell(TopsideEvent::VehicleSilent(silence));
        }
        if self.keeper.is_due(now, position(&self.collector, self.camera.as_ref())) {
            self.events.tell(TopsideEvent::Store);
        }
    }

    fn silence(&self, now: f64) -> Option<f64> {
        Some(now - self.heard?)
    }

    /// What there is of a frame's packet, if enough of it came for a picture.
    pub fn packet(&self, frame: u32) -> Option<CollectedPacket<'_>> {
        self.collector.packet(self.stream, frame)
    }

    /// User bytes of a packet, without the stamp.
    pub fn user_of<'a>(&self, packet: &CollectedPacket<'a>) -> &'a [u8] {
        packet.user.and_then(|user| user.get(exposure::EXPOSURE_LEN..)).unwrap_or_default()
    }

    /// How old a packet's frame was at the last call, seconds, and by whose clock. It is never told too small. `None`:
    /// the packet does not tell, or by a clock of the vehicle that is off.
    pub fn age(&self, packet: &CollectedPacket) -> Option<(f64, ClockSource)> {
        let age = exposure::age(packet.user?, self.timeline.told(self.timeline.last()));
        age.filter(|(_, source)| self.is_utc || *source == ClockSource::Reports)
    }

    /// Whether a packet tells its frame's time by the vehicle's own clock.
    pub(crate) fn is_by_vehicle(&self, packet: &CollectedPacket) -> bool {
        self.is_utc && packet.user.is_some_and(exposure::is_by_vehicle)
    }

    /// From which age on a frame's picture is old, as its packet tells, seconds.
    pub fn age_limit(&self, packet: &CollectedPacket) -> f64 {
        packet.user.map_or(AgeLimit::UNTOLD.seconds(), exposure::limit)
    }

    /// What the pilot looks at gets more of the bytes, from the next report on.
    pub fn set_region(&mut self, region: Option<Region>) {
        if region != self.region {
            self.region = region;
            // The vehicle is told at once.
            self.reported = f64::NEG_INFINITY;
        }
    }

    /// The pilot's region.
    pub fn region(&self) -> Option<Region> {
        self.region
    }

    /// User bytes of reports from here on, up to 247. If a report has no room for them they are left out.
    ///
    /// # Errors
    /// If they are more.
    pub fn set_user(&mut self, user: &[u8]) -> Result<(), LinkError> {
        if user.len() > MOST_USER - PilotMessage::MOST {
            return Err(ModemError::UserBytes(user.len()).into());
        }
        self.user.clear();
        self.user.extend(user);
        Ok(())
    }

    /// The report that is due now, as a modem frame for the return channel; `None`: none is. `kept`: whether a frame
    /// was decoded in full; `holds`: whether a pose is held; `lacks_start`: packets come, and what they are about is
    /// not known.
    ///
    /// # Errors
    /// If the time is not finite.
    pub fn report(
        &mut self,
        now: f64,
        kept: impl Fn(u32) -> bool,
        holds: Option<impl Fn(u32) -> bool>,
        lacks_start: bool,
    ) -> Result<Option<&[u8]>, LinkError> {
        let (told, now) = (now, self.timeline.at(now)?);
        self.watch(now);
        let due = self.report_due().is_some_and(|due| due <= now);
        if !due || self.silence(now).is_none_or(|silence| silence > PATIENCE) {
            return Ok(None);
        }
        let report = match (self.collector.report(self.stream, kept)?, holds) {
            (Some(mut report), Some(holds)) => {
                report.tell_poses(holds);
                report
            }
            (Some(report), None) => report,
            // What comes cannot be read without what came before: the vehicle is asked.
            (None, _) if lacks_start => Report::new(self.stream, 0, std::iter::empty())?,
            (None, _) => return Ok(None),
        };
        let region = self.region;
        let message = PilotMessage { sent: exposure::stamp(told), announce: lacks_start, region };
        message.write(&self.user, &mut self.message);
        // A vehicle without a clock and without anything to heed needs no message.
        let is_wanted = self.has_stamps || region.is_some() || lacks_start || !self.user.is_empty();
        let mut user = is_wanted.then_some(self.message.as_slice());
        let written = loop {
            match self.collector.write_report(&report, user, &mut self.report) {
                // A small modem frame has no room for all of it.
                Err(ModemError::ReportMtu { .. }) if user.is_some() => {
                    user = match user {
                        Some(all) if all.len() > self.message.len() - self.user.len() => {
                            Some(&self.message[..self.message.len() - self.user.len()])
                        }
                        _ => None,
                    };
                }
                written => break written?,
            }
        };
        self.reported = now;
        Ok(Some(&self.report[..written]))
    }

    /// As [`report`](Self::report), for who decodes elsewhere: which frames were decoded, and which poses are held, is
    /// not known here.
    ///
    /// # Errors
    /// If the time is not finite.
    pub fn report_packets(&mut self, now: f64) -> Result<Option<&[u8]>, LinkError> {
        self.report(now, |_| false, None::<fn(u32) -> bool>, false)
    }

    /// When the next report is due, seconds on the timeline.
    fn report_due(&self) -> Option<f64> {
        Some(self.reported + self.report_every?)
    }

    /// When there is something to do at the latest, by the caller's clock, seconds: a frame whose time is over, or a
    /// report. `None`: nothing waits.
    pub fn due(&self) -> Option<f64> {
        let report = self.heard.and_then(|_| self.report_due());
        let due = [self.deadline(), report].into_iter().flatten().reduce(f64::min)?;
        Some(self.timeline.told(due.max(self.timeline.last())))
    }

    /// The next event.
    pub fn event(&mut self) -> Option<TopsideEvent> {
        self.events.take()
    }

    /// The camera that the vehicle was known to have, as the state tells or [`TopsideLink::set_camera`] did.
    pub fn camera(&self) -> Option<&Camera> {
        self.camera.as_ref()
    }

    /// The vehicle's camera is known: the state keeps it.
    pub fn set_camera(&mut self, camera: &Camera) {
        self.camera = Some(*camera);
    }

    /// Replaces what `into` held by what this end goes on with if it starts again: store it when
    /// [`TopsideEvent::Store`] says so. At most [`MAX_STATE`](super::MAX_STATE) bytes.
    pub fn state(&mut self, into: &mut Vec<u8>) {
        into.reserve(MAX_STATE);
        let now = self.timeline.last();
        self.keeper.write(now, position(&self.collector, self.camera.as_ref()), into);
    }

    /// What has come so far.
    pub fn statistics(&self) -> CollectorStatistics {
        self.collector.statistics()
    }

    /// What puts packets together.
    pub fn collector(&self) -> &Collector {
        &self.collector
    }
}

fn position<'a>(
    collector: &'a Collector,
    camera: Option<&'a Camera>,
) -> Position<'a, impl Iterator<Item = crate::keys::Seen> + 'a> {
    Position { next: collector.next_number(), frame: 0, seen: collector.seen(), camera }
}
