//! The vehicle's end without pixels: packets in, modem frames out; reports in, orders to the encoder out.

use std::collections::VecDeque;

use crate::keys::Keys;
use crate::modem::{
    Division, Loss, ModemError, PacketState, Protection, Report, Sender, SenderStatistics,
};
use nvsprior::residual::ResidualError;

use super::age_limit::AgeLimit;
use super::codec::LinkEncoder;
use super::error::LinkError;
use super::event::{Events, VehicleEvent};
use super::exposure::{self, ClockSource, EXPOSURE_LEN, TopsideClock};
use super::frame_numbers::FrameNumbers;
use super::hearing::{FullPackets, Hearing};
use super::options::{Pacing, VehicleOptions};
use super::pilot::{PilotMessage, Region};
use super::pull::PullRate;
use super::stored::{Keeper, MAX_STATE, Position, Side, Stored};
use super::timeline::Timeline;

/// A camera frame that is to be encoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PlannedFrame {
    /// Its number.
    pub number: u32,
    /// Bytes of its packet: [`Encoder::set_steady_bytes`](nvsprior::Encoder::set_steady_bytes).
    pub bytes: usize,
}

/// The vehicle's end for who has packets: they come from an encoder of his own, or of another machine.
///
/// For each camera frame: [`plan`](Self::plan), encode, [`push`](Self::push). [`Vehicle`](super::Vehicle) does it for
/// who has frames. Nothing is allocated after [`new`](Self::new).
pub struct VehicleLink {
    sender: Sender,
    protection: Protection,
    pacing: Pacing,
    pull: Option<PullRate>,
    timeline: Timeline,
    numbers: FrameNumbers,
    /// Most pictures per second.
    picture_rate: f64,
    /// When the frames that are coded were exposed, the earlier one first.
    planned: VecDeque<Planned>,
    stamps: Option<Stamps>,
    user_bytes: usize,
    hearing: Hearing,
    full: FullPackets,
    /// What the encoder does not know yet.
    orders: Orders,
    /// User bytes of the last report that had some.
    user: Vec<u8>,
    /// Those of a packet, with the stamp.
    user_of_packet: Vec<u8>,
    keeper: Keeper,
    events: Events<VehicleEvent>,
    resent_bytes: u64,
}

#[derive(Clone, Copy)]
struct Planned {
    exposed: f64,
    /// As the caller's clock told it.
    told: f64,
}

/// What it takes to tell when a frame was exposed.
struct Stamps {
    is_utc: bool,
    clock: TopsideClock,
}

/// What the encoder is to be told before the next frame.
#[derive(Default)]
struct Orders {
    reports: VecDeque<Report>,
    announce: bool,
    region: Option<Region>,
    is_other_region: bool,
}

/// Reports that wait for a frame.
const REPORTS: usize = 4;
/// Frames that are coded at once.
const PLANNED: usize = 2;
const MOST_USER: usize = 255;

impl VehicleLink {
    /// Takes all its memory here: [`VehicleLink::memory`].
    ///
    /// # Errors
    /// With the option that is outside its range, and what it allows. If the state is not a vehicle's, or of a later
    /// epoch. If the system does not have the memory.
    pub fn new(options: &VehicleOptions) -> Result<VehicleLink, LinkError> {
        let stored = match options.state.as_slice() {
            [] => Stored::default(),
            state => Stored::read(Side::Vehicle, state)?,
        };
        let keys = options.keys.as_ref().map(|keys| stored.resumed(keys)).transpose()?;
        let sender = options.sender()?;
        let control = &sender.control;
        let has_stamps = control.user.is_some();
        let pull = (options.pacing == Pacing::Pull)
            .then(|| PullRate::new(control.frame_rate, control.latency, control.min_bytes));
        let stored = Stored { epoch: keys.as_ref().map_or(0, Keys::epoch), ..stored };
        let mut events = Events::new();
        // Before anything goes.
        events.tell(VehicleEvent::Store);
        Ok(VehicleLink {
            protection: options.protection,
            pacing: options.pacing,
            pull,
            timeline: Timeline::default(),
            numbers: FrameNumbers::new(options.frame_rate, stored.frame),
            picture_rate: control.frame_rate,
            planned: VecDeque::with_capacity(PLANNED + 1),
            stamps: has_stamps
                .then(|| Stamps { is_utc: options.is_utc, clock: TopsideClock::default() }),
            user_bytes: options.user_bytes,
            hearing: Hearing::default(),
            full: FullPackets::default(),
            orders: Orders { reports: VecDeque::with_capacity(REPORTS + 1), ..Orders::default() },
            user: Vec::with_capacity(MOST_USER),
            user_of_packet: Vec::with_capacity(MOST_USER),
            keeper: Keeper::new(Side::Vehicle, stored),
            events,
            resent_bytes: 0,
            sender: match &keys {
                Some(keys) => Sender::with_keys(sender, keys)?,
                None => Sender::new(sender)?,
            },
        })
    }

    /// Memory that it takes at most, bytes.
    ///
    /// # Errors
    /// With the option that is outside its range.
    pub fn memory(options: &VehicleOptions) -> Result<usize, LinkError> {
        let sender = options.sender()?;
        let memory = match &options.keys {
            Some(keys) => sender.memory_with_keys(keys)?,
            None => sender.memory()?,
        };
        /// Lists of fixed length.
        const OTHERS: usize = 16 << 10;
        Ok(memory + OTHERS)
    }

    /// Counts a camera frame that was exposed at a time, and tells how to encode it. `None`: it is left out, as the
    /// link has no bytes for it, or will not have by the time it is coded.
    ///
    /// # Errors
    /// If a time is not finite.
    pub fn plan(&mut self, now: f64, exposed: f64) -> Result<Option<PlannedFrame>, LinkError> {
        self.planned.clear();
        while self.sender.drop_plan() {}
        self.plan_another(now, exposed)
    }

    /// As [`plan`](Self::plan), while the frame planned before is still coded.
    ///
    /// # Errors
    /// As [`plan`](Self::plan).
    pub fn plan_another(
        &mut self,
        now: f64,
        exposed: f64,
    ) -> Result<Option<PlannedFrame>, LinkError> {
        let (now, told) = (self.timeline.at(now)?, exposed);
        let exposed = self.timeline.of(exposed)?;
        let number = self.count(exposed)?;
        self.watch(now);
        if self.planned.len() == PLANNED {
            return Ok(None);
        }
        let bytes = match &mut self.pull {
            None => self.sender.plan_another(exposed)?,
            Some(pull) => {
                let mtu = self.sender.mtu();
                let frames = pull.frames(now, self.sender.pulled_bytes(), mtu);
                let most = pull.least().unwrap_or(mtu).min(mtu);
                match frames.filter(|_| self.planned.is_empty()) {
                    Some(frames) => self.sender.plan_frames(exposed, frames, most)?,
                    None => None,
                }
            }
        };
        let Some(bytes) = bytes else { return Ok(None) };
        self.planned.push_back(Planned { exposed, told });
        Ok(Some(PlannedFrame { number, bytes }))
    }

    /// Counts a camera frame that is not encoded, as there is no time for it.
    ///
    /// # Errors
    /// If a time is not finite.
    pub fn leave_out(&mut self, now: f64, exposed: f64) -> Result<(), LinkError> {
        self.timeline.at(now)?;
        let exposed = self.timeline.of(exposed)?;
        self.count(exposed).map(drop)
    }

    fn count(&mut self, exposed: f64) -> Result<u32, LinkError> {
        let number = self.numbers.count(exposed);
        if let Some(rate) = self.numbers.changed_rate() {
            if self.pacing != Pacing::AsTheyCome {
                self.sender.set_frame_rate(rate.min(self.picture_rate))?;
            }
            self.events.tell(VehicleEvent::FrameRate(rate));
        }
        Ok(number)
    }

    /// Drops the earlier of the frames that were planned: it could not be encoded.
    pub fn drop_plan(&mut self) {
        self.planned.pop_front();
        self.sender.drop_plan();
    }

    /// Takes the packet of the frame that was planned first, which is ready now, and the user bytes that travel with
    /// it. Tells how it is divided.
    ///
    /// # Errors
    /// If no frame was planned, the bytes are not one packet, there are not as many user bytes as the options say, or
    /// all modem frames together do not hold a picture. Nothing is sent then.
    pub fn push(&mut self, now: f64, packet: &[u8], user: &[u8]) -> Result<Division, LinkError> {
        // It may be ready in a while: that is no time of a call.
        let now = self.timeline.of(now)?;
        let unpaced = Planned { exposed: now, told: now };
        let planned = self.planned.front().copied();
        let planned = planned.or((self.pacing == Pacing::AsTheyCome).then_some(unpaced));
        let Planned { exposed, told } = planned.ok_or(ModemError::NotPlanned)?;
        if user.len() != self.user_bytes {
            return Err(ModemError::UserBytes(user.len()).into());
        }
        self.user_of_packet.clear();
        if let Some(stamps) = &self.stamps {
            let limit = AgeLimit::of(self.sender.options());
            self.user_of_packet.extend(stamps.written(exposed, told, limit));
            self.user_of_packet.extend(user);
        }
        let with_user = self.stamps.is_some().then_some(self.user_of_packet.as_slice());
        let pushed = self.sender.push(now, packet, with_user);
        self.planned.pop_front();
        let division = match pushed {
            Ok(division) => division,
            Err(error) => {
                // The topside does not hear of what this packet says.
                self.orders.announce = true;
                self.sender.drop_plan();
                return Err(error.into());
            }
        };
        let bit_rate = self.sender.options().bit_rate;
        if bit_rate > 0.0 {
            self.full.sent(now, division.link_bytes as f64 * 8.0 / bit_rate);
        }
        if let Some(pull) = &mut self.pull {
            pull.ready(now, exposed);
        }
        Ok(division)
    }

    /// Takes what the modem received. A report is read; what the encoder is to know waits for the next frame.
    ///
    /// # Errors
    /// If it is no report, or none for this vehicle. That is no failure of the link.
    pub fn receive(&mut self, now: f64, bytes: &[u8]) -> Result<(), LinkError> {
        let now = self.timeline.at(now)?;
        self.watch(now);
        let read = self.sender.read_report(bytes).and_then(|(report, user)| {
            let resent = self.sender.process_report(now, &report)?;
            Ok((report, user, resent))
        });
        let (report, user, resent) = match read {
            Ok(read) => read,
            Err(error) => {
                self.events.tell(self.hearing.stranger());
                return Err(error.into());
            }
        };
        self.resent_bytes += resent.bytes as u64;
        self.events.tell(self.hearing.report(now));
        if self.orders.reports.len() == REPORTS {
            self.orders.reports.pop_front();
        }
        self.orders.reports.push_back(report);
        let Some((message, user)) = user.and_then(PilotMessage::read) else { return Ok(()) };
        self.heed(now, message, user);
        Ok(())
    }

    /// Does what the topside wants.
    fn heed(&mut self, now: f64, message: PilotMessage, user: &[u8]) {
        let PilotMessage { sent, announce, region } = message;
        if let Some(stamps) = &mut self.stamps {
            stamps.clock.reported(now, sent);
        }
        if announce && self.full.ask(now) {
            self.orders.announce = true;
            self.events.tell(VehicleEvent::Asked);
        }
        if region != self.orders.region {
            (self.orders.region, self.orders.is_other_region) = (region, true);
            self.events.tell(VehicleEvent::Region(region));
        }
        if !user.is_empty() {
            self.user.clear();
            self.user.extend(user);
            self.events.tell(VehicleEvent::User);
        }
    }

    /// Tells the encoder what came since the last frame: what the topside holds, whether it asks for prior and camera,
    /// and the pilot's region. Call it before each frame.
    ///
    /// # Errors
    /// If the camera's picture is too small for the region.
    pub fn instruct(&mut self, encoder: &mut impl LinkEncoder) -> Result<(), ResidualError> {
        for report in self.orders.reports.drain(..) {
            let kept = report.packets().filter(|(_, packet)| packet.state == PacketState::Kept);
            kept.for_each(|(frame, _)| encoder.acknowledge(frame));
            report.poses().for_each(|(frame, held)| encoder.acknowledge_pose(frame, held));
        }
        if std::mem::take(&mut self.orders.announce) {
            encoder.announce();
        }
        if std::mem::take(&mut self.orders.is_other_region) {
            let size = encoder.size();
            let interest = self.orders.region.map(|region| region.interest(size)).transpose()?;
            encoder.set_interest(interest);
        }
        Ok(())
    }

    /// The next modem frame, if one is due now and has at most so many bytes. A modem that shares its link with other
    /// traffic asks with the bytes that it has room for: [`Pacing::Pull`]. Others give the MTU. `None`: none.
    ///
    /// # Errors
    /// If the time is not finite.
    pub fn transmit(&mut self, now: f64, most: usize) -> Result<Option<&[u8]>, LinkError> {
        let now = self.timeline.at(now)?;
        self.watch(now);
        if let Some(pull) = &mut self.pull {
            pull.pulled(now, most);
            if let Some(rate) = pull.rate(now).filter(|rate| *rate > 0.0) {
                self.sender.set_bit_rate(now, 8.0 * rate)?;
            }
            if self.sender.next_len(f64::INFINITY).is_some_and(|len| len <= most) {
                pull.touched();
            }
            return Ok(self.sender.pull(most));
        }
        if self.sender.next_len(now).is_none_or(|len| len > most) {
            return Ok(None);
        }
        Ok(self.sender.next(now).map(|(_, frame)| frame))
    }

    /// When the next modem frame is due, by the caller's clock, seconds; it may have passed. `None`: none waits, or the
    /// modem pulls.
    pub fn due(&self) -> Option<f64> {
        let due = self.sender.due().filter(|_| self.pull.is_none())?;
        Some(self.timeline.told(due))
    }

    /// The next event.
    pub fn event(&mut self) -> Option<VehicleEvent> {
        self.events.take()
    }

    /// User bytes of the last report that had some.
    pub fn user(&self) -> &[u8] {
        &self.user
    }

    /// Looks what there is to tell.
    fn watch(&mut self, now: f64) {
        self.events.tell(self.hearing.silence(now));
        let at = position(&self.sender, &self.numbers);
        if self.keeper.is_due(now, at) {
            self.events.tell(VehicleEvent::Store);
        }
    }

    /// Replaces what `into` held by what this end goes on with if it starts again: store it when
    /// [`VehicleEvent::Store`] says so. At most [`MAX_STATE`](super::MAX_STATE) bytes.
    pub fn state(&mut self, into: &mut Vec<u8>) {
        into.reserve(MAX_STATE);
        let now = self.timeline.last();
        self.keeper.write(now, position(&self.sender, &self.numbers), into);
    }

    /// Counts bytes that are given to the link besides: pictures get the fewer.
    ///
    /// # Errors
    /// If the time is not finite.
    pub fn count_others(&mut self, now: f64, bytes: usize) -> Result<(), LinkError> {
        let now = self.timeline.at(now)?;
        Ok(self.sender.count(now, bytes)?)
    }

    /// The link carries another bit rate from now on.
    ///
    /// # Errors
    /// If it is not positive and finite, or this end goes by no bit rate.
    pub fn set_bit_rate(&mut self, now: f64, bit_rate: f64) -> Result<(), LinkError> {
        let now = self.timeline.at(now)?;
        match self.pacing {
            Pacing::Rate(_) => Ok(self.sender.set_bit_rate(now, bit_rate)?),
            Pacing::Pull | Pacing::AsTheyCome => Err(ModemError::Unpaced.into()),
        }
    }

    /// The link's loss, as it was measured: packets from here on are protected against it.
    ///
    /// # Errors
    /// If it is outside its range, or this end has no protection to speak of.
    pub fn set_loss(&mut self, loss: Loss) -> Result<(), LinkError> {
        Ok(self.sender.set_loss(loss)?)
    }

    /// Number of the next frame.
    pub fn next_frame(&self) -> u32 {
        self.numbers.next()
    }

    /// What was sent so far.
    pub fn statistics(&self) -> SenderStatistics {
        self.sender.statistics()
    }

    /// Bytes of modem frames that were sent again, as they cost on the link.
    pub fn resent_bytes(&self) -> u64 {
        self.resent_bytes
    }

    /// How it sends, with rate and loss as they are now.
    pub fn sender(&self) -> &Sender {
        &self.sender
    }

    /// What is done against losses.
    pub fn protection(&self) -> Protection {
        self.protection
    }
}

fn position<'a>(
    sender: &'a Sender,
    numbers: &FrameNumbers,
) -> Position<'a, impl Iterator<Item = crate::keys::Seen> + 'a> {
    let frame = numbers.next();
    Position { next: sender.next_number(), frame, seen: sender.seen(), camera: None }
}

impl Stamps {
    /// When a frame was exposed, as its packet tells it.
    fn written(&self, exposed: f64, told: f64, limit: AgeLimit) -> [u8; EXPOSURE_LEN] {
        let by_reports = self.clock.at(exposed).map(|time| (time, ClockSource::Reports));
        let by_own = self.is_utc.then_some((told, ClockSource::Vehicle));
        exposure::written(by_reports.or(by_own), limit)
    }
}
