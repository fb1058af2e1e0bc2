//! What a topside decodes and draws next, and what it knows of the frames that it did.

use std::collections::VecDeque;

use nvsprior::packet::{Extent, PacketError};
use nvsprior::{Camera, Decoded, Error, Pose};

use super::codec::LinkDecoder;
use super::exposure::ClockSource;
use super::frame_set::FrameSet;
use super::options::{Playout, TopsideOptions};
use super::playout::{Due, number_of};
use super::topside_link::TopsideLink;

/// What a picture shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shows {
    /// What came of the frame's own packet.
    Own,
    /// The prior, at a pose between those of frames that came.
    Between,
}

/// What is known of the picture that is shown, besides [`Decoded`].
#[derive(Clone, Debug)]
pub struct Shown {
    /// What it shows.
    pub shows: Shows,
    /// Frame number, counted on beyond 2¹⁶.
    pub frame: i64,
    /// With [`Playout::InOrder`] the frame's time, else when the modem frame came after which it was decoded; seconds.
    pub time: f64,
    /// How old the frame was at that time at least, seconds: as its packet tells by a clock, else since its packet
    /// began to come.
    pub age: f64,
    /// Whose clock told the age; `None`: none did.
    pub clock: Option<ClockSource>,
    /// The vehicle told the time by its own clock, and that cannot be right: it wants to be set.
    pub is_clock_off: bool,
    /// From which age on the picture is old, seconds.
    pub old: f64,
    /// It does not follow the one before: the vehicle has begun anew.
    pub restarted: bool,
    /// Modem frames of its packet that came, and that were sent if that is known.
    pub shares: (usize, Option<usize>),
    /// Bytes of its packet that came.
    pub bytes: usize,
    /// All of its packet came.
    pub complete: bool,
    /// The vehicle's camera.
    pub camera: Camera,
}

/// Something for the decoder.
#[derive(Clone, Debug)]
pub enum Work {
    /// Decode what there is of a frame's packet. With `due` it is shown in its turn.
    Decode { frame: u32, due: Option<Due> },
    /// Draw the prior for a frame that did not come.
    Draw { frame: i64, time: f64, pose: Pose },
    /// It is decoded already.
    Ready { at: usize, due: Due },
}

impl Work {
    /// Has the decoder do it. `false`: the packet is not held any more, or no camera is known.
    ///
    /// # Errors
    /// As the decoder.
    pub fn perform(
        &self,
        link: &TopsideLink,
        decoder: &mut impl LinkDecoder,
        decoded: &mut Decoded,
    ) -> Result<bool, Error> {
        match self {
            Work::Decode { frame, .. } => match link.packet(*frame) {
                Some(packet) => decoder.decode(packet.bytes, decoded).map(|()| true),
                None => Ok(false),
            },
            Work::Draw { pose, .. } => decoder.draw(pose, &mut decoded.picture),
            Work::Ready { .. } => Ok(true),
        }
    }
}

/// What came of work.
pub enum Done {
    /// There is a picture to show.
    Picture(Shown),
    Nothing,
}

/// Packets that are known.
const PACKETS: usize = 64;
/// Stamps are cut to their steps, and clocks are not set to less; seconds.
const CLOCK_STEP: f64 = 0.2;
/// A reference is one of so many frames before.
const FARTHEST: u32 = 32;
/// A frame that lies before the shown one is none of the past if nothing was shown for so long, seconds: the vehicle
/// has begun anew.
const ANEW: f64 = 4.0;
/// Seconds between two frames between which the prior is drawn.
const REACH: f64 = 3.0;
const MOST_BETWEEN: i64 = 32;

pub struct Screen {
    playout: Playout,
    /// Seconds after which another packet may have the same number.
    stale: f64,
    /// When packets began to come, seconds.
    began: VecDeque<(u32, f64)>,
    /// Those whose poses the decoder has not been told yet.
    to_hold: FrameSet,
    /// Frames are predicted from others.
    is_stream: bool,
    /// Whole packets of a stream that later ones may be predicted from, or whose own references are missing yet.
    waiting: FrameSet,
    /// Another whole packet came since they were tried.
    has_whole: bool,
    /// Frames that were decoded in full.
    kept: FrameSet,
    /// Frames to decode in this round.
    agenda: FrameSet,
    /// Pictures that were decoded before their turn.
    ready: Vec<Decoded>,
    spare: Vec<Decoded>,
    /// The last frame that was shown, and when.
    shown: Option<(i64, f64)>,
    /// Its pose, if the vehicle was certain of it.
    certain: Option<Pose>,
    /// The frame whose turn it is, after those between.
    turn: Option<Turn>,
    lacks_camera: bool,
    /// Packets come whose poses are predicted from poses that are not held.
    lacks_poses: bool,
    /// Of no whole packet all could be shown yet: a stream may go on from frames that a run before has seen.
    is_anew: bool,
}

struct Turn {
    due: Due,
    /// The next frame to draw before it.
    next: i64,
    from: Option<Turning>,
    to: Option<Pose>,
}

/// Where the way to a turn begins.
#[derive(Clone, Copy)]
struct Turning {
    frame: i64,
    time: f64,
    pose: Pose,
}

impl Screen {
    pub fn new(options: &TopsideOptions, link: &TopsideLink) -> Screen {
        let set = || FrameSet::with_room(PACKETS);
        Screen {
            playout: options.playout,
            stale: link.collector().options().age,
            began: VecDeque::with_capacity(PACKETS + 1),
            to_hold: set(),
            is_stream: false,
            waiting: set(),
            has_whole: false,
            kept: set(),
            agenda: set(),
            ready: Vec::with_capacity(PACKETS + 1),
            spare: Vec::with_capacity(PACKETS + 1),
            shown: None,
            certain: None,
            turn: None,
            lacks_camera: false,
            lacks_poses: false,
            is_anew: true,
        }
    }

    /// Notes a modem frame of the vehicle that came at `now`, and the frame whose packet it made longer, or whole.
    pub fn note(&mut self, now: f64, grown: Option<(u32, bool)>, link: &TopsideLink) {
        let Some((frame, is_whole)) = grown else { return };
        if !self.began.iter().any(|(number, at)| *number == frame && now - at <= self.stale) {
            // A vehicle that begins anew may have the same numbers.
            self.began.retain(|(number, _)| *number != frame);
            self.kept.remove(frame);
            if self.began.len() == PACKETS {
                self.began.pop_front();
            }
            self.began.push_back((frame, now));
        }
        self.to_hold.insert(frame);
        let packet = link.packet(frame).map(|packet| Extent::read(packet.bytes));
        self.is_stream |= matches!(packet, Some(Ok(Extent { in_stream: true, .. })));
        if is_whole && self.is_stream {
            self.waiting.insert(frame);
            self.has_whole = true;
        }
    }

    /// Holds the poses of packets as soon as they come: later ones are predicted from them.
    pub fn hold(&mut self, link: &TopsideLink, decoder: &mut impl LinkDecoder) {
        while let Some(frame) = self.to_hold.pop_least() {
            if let Some(packet) = link.packet(frame) {
                // If it cannot be read, it is not held, and the vehicle is told.
                let _ = decoder.hold(packet.bytes);
            }
        }
    }

    /// What is to be done next; `None`: nothing is at `now`.
    pub fn next(
        &mut self,
        now: f64,
        link: &mut TopsideLink,
        decoder: &impl LinkDecoder,
    ) -> Option<Work> {
        if let Some(frame) = self.next_of_agenda(link) {
            return Some(Work::Decode { frame, due: None });
        }
        if self.turn.is_none() {
            let due = link.next_due(now)?;
            self.turn = Some(self.turn_of(due, link, decoder));
        }
        self.next_of_turn()
    }

    fn next_of_agenda(&mut self, link: &mut TopsideLink) -> Option<u32> {
        if self.agenda.is_empty() {
            if std::mem::take(&mut self.has_whole) {
                self.waiting.iter().for_each(|frame| self.agenda.insert(frame));
                self.waiting.clear();
            }
            let (is_newest, lacks_camera) = (self.playout == Playout::Newest, self.lacks_camera);
            let (agenda, mut newest) = (&mut self.agenda, None);
            link.take_grown(|frame| {
                newest = newest.max(Some(frame));
                // An earlier one tells the camera.
                if is_newest && lacks_camera {
                    agenda.insert(frame);
                }
            });
            if let (true, Some(newest)) = (is_newest, newest) {
                agenda.insert(newest);
            }
        }
        while let Some(frame) = self.agenda.pop_least() {
            if !self.kept.contains(frame) {
                return Some(frame);
            }
        }
        None
    }

    /// The way to a frame whose turn it is.
    fn turn_of(&self, due: Due, link: &TopsideLink, decoder: &impl LinkDecoder) -> Turn {
        let certain = |frame: i64| {
            let packet = link.packet(number_of(frame))?;
            let (pose, is_certain) = decoder.pose_of(packet.bytes).ok()?;
            is_certain.then_some(pose)
        };
        let plain = Turn { due, next: due.frame, from: None, to: None };
        let Some(((last, time), pose)) = self.shown.zip(self.certain) else { return plain };
        let is_near = due.frame - last <= MOST_BETWEEN && due.time - time <= REACH;
        match certain(due.frame).filter(|_| is_near && !due.restarted) {
            Some(to) => {
                let from = Some(Turning { frame: last, time, pose });
                Turn { next: last + 1, from, to: Some(to), ..plain }
            }
            None => plain,
        }
    }

    fn next_of_turn(&mut self) -> Option<Work> {
        let turn = self.turn.as_mut()?;
        if let (Some(from), Some(to)) = (turn.from, turn.to)
            && turn.next < turn.due.frame
        {
            let frame = turn.next;
            turn.next += 1;
            let part = (frame - from.frame) as f64 / (turn.due.frame - from.frame) as f64;
            let time = from.time + part * (turn.due.time - from.time);
            return Some(Work::Draw { frame, time, pose: from.pose.between(&to, part) });
        }
        let due = self.turn.take()?.due;
        let number = number_of(due.frame);
        let ready = self.ready.iter().position(|ready| number_of(ready.frame.into()) == number);
        Some(match ready {
            Some(at) => Work::Ready { at, due },
            None => Work::Decode { frame: number, due: Some(due) },
        })
    }

    /// Takes what came of work: `decoded` is the picture, if the outcome is good. Buffers are swapped, not copied.
    ///
    /// # Errors
    /// With why a packet cannot be shown, or if the device fails.
    pub fn done(
        &mut self,
        now: f64,
        work: Work,
        outcome: Result<bool, Error>,
        decoded: &mut Decoded,
        link: &TopsideLink,
        decoder: &impl LinkDecoder,
    ) -> Result<Done, Error> {
        if matches!(outcome, Ok(false)) {
            return Ok(Done::Nothing);
        }
        let camera = decoder.camera().copied();
        match work {
            Work::Decode { frame, due } => {
                self.decoded(frame, outcome, decoded, link)?;
                let shown = match due {
                    Some(due) => Some((due.frame, due.time, due.restarted)),
                    None => self.early(now, frame, decoded),
                };
                Ok(self.show(now, shown, frame, link, camera, decoded))
            }
            Work::Draw { frame, time, pose } => {
                outcome?;
                decoded.truth.reset(decoded.picture.width, decoded.picture.height);
                decoded.frame = number_of(frame);
                (decoded.pose, decoded.rows, decoded.filtered) = (pose, 0, false);
                (decoded.damage, decoded.reference, decoded.kept) = (None, None, false);
                (decoded.same_render, decoded.known, decoded.uncertain) = (None, None, false);
                let Some(camera) = camera else { return Ok(Done::Nothing) };
                Ok(Done::Picture(Shown {
                    shows: Shows::Between,
                    frame,
                    time,
                    age: (now - time).max(0.0),
                    clock: None,
                    is_clock_off: false,
                    old: super::age_limit::AgeLimit::UNTOLD.seconds(),
                    restarted: false,
                    shares: (0, None),
                    bytes: 0,
                    complete: false,
                    camera,
                }))
            }
            Work::Ready { at, due } => {
                let ready = self.ready.swap_remove(at);
                self.spare.push(std::mem::replace(decoded, ready));
                let shown = Some((due.frame, due.time, due.restarted));
                Ok(self.show(now, shown, number_of(due.frame), link, camera, decoded))
            }
        }
    }

    /// Learns from a packet that was decoded, or refused.
    fn decoded(
        &mut self,
        frame: u32,
        outcome: Result<bool, Error>,
        decoded: &Decoded,
        link: &TopsideLink,
    ) -> Result<(), Error> {
        if let Err(error) = outcome {
            let is_waiting = matches!(error, Error::Packet(PacketError::PoseNotHeld { .. }));
            self.lacks_camera |=
                matches!(error, Error::SessionUnknown { .. } | Error::Estranged { .. });
            self.lacks_poses |= is_waiting;
            if self.is_stream && is_waiting && !self.is_past(frame) {
                self.waiting.insert(frame);
            }
            return Err(error);
        }
        (self.lacks_camera, self.lacks_poses) = (false, false);
        let is_whole = link.packet(frame).is_some_and(|packet| packet.complete);
        self.is_anew &= !is_whole || decoded.damage.is_some();
        self.is_stream |= decoded.kept || decoded.reference.is_some();
        if decoded.kept {
            self.kept.insert(frame);
        } else if self.is_stream && is_whole && !self.is_past(frame) {
            self.waiting.insert(frame);
        }
        Ok(())
    }

    /// No reference of a frame will come any more.
    fn is_past(&self, frame: u32) -> bool {
        self.began.back().is_some_and(|(newest, _)| frame.saturating_add(FARTHEST) < *newest)
    }

    /// What a packet that was decoded out of turn is shown as; `None`: it is not, or later.
    fn early(&mut self, now: f64, frame: u32, decoded: &mut Decoded) -> Option<(i64, f64, bool)> {
        match self.playout {
            Playout::Newest => {
                let frame = i64::from(frame);
                let (last, at) = self.shown.unwrap_or((i64::MIN, f64::MIN));
                let restarted = frame < last;
                (!restarted || now - at >= ANEW).then_some((frame, now, restarted))
            }
            Playout::InOrder { .. } | Playout::OnDemand => {
                if decoded.kept {
                    let mut spare = self.spare.pop().unwrap_or_default();
                    std::mem::swap(&mut spare, decoded);
                    self.ready.push(spare);
                    if self.ready.len() > PACKETS {
                        let oldest = self.ready.remove(0);
                        self.spare.push(oldest);
                    }
                }
                None
            }
        }
    }

    /// Notes what is shown.
    fn show(
        &mut self,
        now: f64,
        shown: Option<(i64, f64, bool)>,
        number: u32,
        link: &TopsideLink,
        camera: Option<Camera>,
        decoded: &Decoded,
    ) -> Done {
        let Some(((frame, time, restarted), camera)) = shown.zip(camera) else {
            return Done::Nothing;
        };
        self.shown = Some((frame, time));
        self.certain = (!decoded.uncertain).then_some(decoded.pose);
        self.drop_ready(frame);
        let Some(packet) = link.packet(number) else { return Done::Nothing };
        let began = self.began.iter().find(|(frame, _)| *frame == number);
        let since = began.map_or(0.0, |(_, began)| (now - began).max(0.0));
        // No frame is newer than its packet.
        let can_be = |(age, source): &(f64, ClockSource)| {
            *source == ClockSource::Reports || age + CLOCK_STEP >= since
        };
        let told = link.age(&packet).filter(can_be);
        Done::Picture(Shown {
            shows: Shows::Own,
            frame,
            time,
            age: told.map_or(since, |(age, _)| age),
            clock: told.map(|(_, source)| source),
            is_clock_off: told.is_none() && link.is_by_vehicle(&packet),
            old: link.age_limit(&packet),
            restarted,
            shares: (packet.arrived, packet.sent),
            bytes: packet.bytes.len(),
            complete: packet.complete,
            camera,
        })
    }

    /// Pictures whose turn is over are not wanted any more.
    fn drop_ready(&mut self, shown: i64) {
        let mut at = 0;
        while at < self.ready.len() {
            match is_not_after(self.ready[at].frame, shown) {
                true => self.spare.push(self.ready.swap_remove(at)),
                false => at += 1,
            }
        }
    }

    /// Takes a picture that was decoded before its turn.
    pub fn take_ready(&mut self, frame: u32, decoded: &mut Decoded) -> bool {
        let number = |frame: u32| number_of(frame.into());
        let at = self.ready.iter().position(|ready| number(ready.frame) == number(frame));
        let ready = at.map(|at| self.ready.swap_remove(at));
        self.drop_ready(frame.into());
        let is_there = ready.is_some();
        if let Some(ready) = ready {
            self.spare.push(std::mem::replace(decoded, ready));
        }
        is_there
    }

    /// Whether a frame was decoded in full.
    pub fn kept(&self, frame: u32) -> bool {
        self.kept.contains(frame)
    }

    /// Packets come, and what they are about, or predicted from, is not known: the vehicle must tell.
    pub fn lacks_start(&self) -> bool {
        let is_anew = self.lacks_poses || self.is_anew;
        self.lacks_camera || is_anew && self.playout != Playout::OnDemand
    }
}

/// Whether a frame comes not after another, as packets state their numbers.
fn is_not_after(frame: u32, other: i64) -> bool {
    number_of(other - i64::from(frame)) < 1 << 15
}
