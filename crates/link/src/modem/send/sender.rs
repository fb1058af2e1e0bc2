//! The vehicle's end of a link: how many bytes a frame may take, its packet to shares, and when each share goes.

use crate::keys::{Keys, Refusal, Seen};
use crate::modem::error::ModemError;
use crate::modem::limits::{MAX_SHARES, MAX_UNPROTECTED, MIN_CHECKED_MTU, MIN_MTU, STREAMS};
use crate::modem::report::Report;
use crate::modem::wire::layout::Layout;
use crate::modem::wire::share::MIN_LEN;
use crate::modem::wire::travelling::Travelling;
use nvsprior::packet::{Extent, Latent, nearest_frame};

use super::division::Division;
use super::history::History;
use super::interleaver::Interleaver;
use super::keyed::Keyed;
use super::loss::Loss;
use super::rate_control::{RateControl, RateControlOptions};
use super::sharer::Sharer;
use super::unprotected::Unprotected;

/// What is done against lost modem frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Protection {
    /// Nothing. The shares are the packet's bytes in order, and cost fewest bytes. What lies behind a lost one is of no
    /// use until it is sent again.
    None,
    /// Any few shares yield a picture; each more makes it finer. See [`Sharing`](crate::modem::Sharing).
    #[default]
    Layers,
}

/// How a sender uses its link.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SenderOptions {
    /// The link, and what its pictures should be. Without protection a bit rate of 0 means that packets go as they
    /// come: none is planned, and only MTU, overhead, spread and shares count.
    pub control: RateControlOptions,
    /// The stream that the packets are of, 0 to 3; without protection 0.
    pub stream: u8,
    /// What is done against losses.
    pub protection: Protection,
    /// The topside sends reports: [`Sender::process_report`]. The sender then remembers what it sent.
    pub expect_reports: bool,
}

impl SenderOptions {
    /// Shares that may wait: those of the packets that come within the latency, at three times the frame rate, and no
    /// more than the link carries in that time.
    fn waiting(&self) -> usize {
        let RateControlOptions { bit_rate, overhead, latency, delay, frame_rate, .. } =
            self.control;
        let max = self.max_shares();
        if bit_rate == 0.0 {
            return 2 * max;
        }
        let packets = 3.0 * (latency - delay) * frame_rate;
        let carried = bit_rate / 8.0 * (latency - delay) / MIN_LEN.saturating_add(overhead) as f64;
        let shares = (packets * max as f64).min(carried) as usize;
        shares.saturating_add(4 * max).min(MAX_WAITING)
    }

    /// Most shares of a packet.
    fn max_shares(&self) -> usize {
        match self.protection {
            Protection::None => {
                let most =
                    Layout::new(self.control.mtu).map_or(MAX_UNPROTECTED, Layout::max_shares);
                self.control.max_shares.min(most)
            }
            Protection::Layers => self.control.max_shares.min(MAX_SHARES),
        }
    }

    fn way(&self) -> Result<Way, ModemError> {
        if self.stream >= STREAMS {
            return Err(ModemError::Stream(self.stream));
        }
        if self.protection == Protection::Layers {
            return Ok(Way::Layers(RateControl::new(self.control)?));
        }
        let link = Unprotected::new(&self.control)?;
        if self.stream > 0 {
            return Err(ModemError::UnprotectedStream(self.stream));
        }
        if self.control.bit_rate != 0.0 {
            return Ok(Way::Unprotected(link, Some(RateControl::unprotected(self.control)?)));
        }
        match self.expect_reports {
            true => Err(ModemError::UnpacedReports),
            false => Ok(Way::Unprotected(link, None)),
        }
    }

    /// Memory that a [`Sender`] takes at most, all of it when it is made, bytes.
    ///
    /// # Errors
    /// If an option is outside its range.
    pub fn memory(&self) -> Result<usize, ModemError> {
        self.way()?;
        let shares = self.waiting() + 4 * self.max_shares() + 2;
        let waiting = shares.saturating_mul(self.control.mtu.saturating_add(LIST));
        let history = if self.expect_reports { History::memory(&self.control) } else { 0 };
        Ok(waiting.saturating_add(history))
    }

    /// The same of a sender [with keys](Sender::with_keys).
    ///
    /// # Errors
    /// As [`SenderOptions::memory`], or if the MTU has no room for tags.
    pub fn memory_with_keys(&self, keys: &Keys) -> Result<usize, ModemError> {
        let memory = self.keyed(keys)?.memory()?;
        Ok(memory.saturating_add(Keyed::memory(self.control.mtu)))
    }

    /// What is left of the link if each modem frame has a tag.
    fn keyed(mut self, keys: &Keys) -> Result<SenderOptions, ModemError> {
        let least = match self.protection {
            Protection::None => MIN_MTU,
            Protection::Layers => MIN_CHECKED_MTU,
        };
        let (mtu, needed) = (self.control.mtu, least + keys.overhead());
        if mtu < needed {
            return Err(ModemError::KeyedMtu { mtu, needed });
        }
        self.control.mtu -= keys.overhead();
        self.control.overhead = self.control.overhead.saturating_add(keys.overhead());
        Ok(self)
    }
}

/// What a share takes beside its own bytes: its places in the lists, and the heap's own.
const LIST: usize = 96;
/// Shares that wait at most, whatever the options are.
const MAX_WAITING: usize = 1 << 16;

/// Counts since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SenderStatistics {
    /// Frames that were left out: [`Sender::plan`] had no bytes for them.
    pub left_out: u64,
    /// Packets that were taken.
    pub packets: u64,
    /// Packets of them whose end was not sent, as they were longer than planned.
    pub cut: u64,
    /// Shares of them.
    pub shares: u64,
    /// Bytes of them on the link, the overhead of each share counted.
    pub bytes: u64,
    /// Shares that were sent again.
    pub resent: u64,
    /// Reports whose tag no key has made: see [`Sender::with_keys`].
    pub foreign: u64,
    /// Reports that came a second time, with keys.
    pub replayed: u64,
}

/// Takes a vehicle's packets, and yields the modem frames to send: rate control, [`Sharer`] and [`Interleaver`] in one.
///
/// For each frame ask for its bytes, encode it in as many, and push the packet. Whenever the modem is free, send the
/// next share that is due. Nothing is allocated after [`Sender::new`].
///
/// ```
/// # fn main() -> Result<(), nvsprior_link::modem::ModemError> {
/// # let send = |share: &[u8]| {};
/// # let encode = |bytes: usize| -> Vec<u8> { vec![
/// #     0x00, 0x00, 0x02, 0x00, 0x72, 0x21, 0xfc, 0xff, 0xfc, 0xff, 0xfc, 0xff, 0x0c, 0x40,
/// #     0x06, 0x20, 0x03, 0x10, 0xe1, 0x3f,
/// # ] };
/// use nvsprior_link::modem::{Loss, Protection, RateControlOptions, Sender, SenderOptions};
/// let control = RateControlOptions {
///     bit_rate: 20_000.0,
///     mtu: 64,
///     overhead: 0,
///     latency: 1.5,
///     delay: 0.5,
///     spread: 0.5,
///     frame_rate: 15.0,
///     min_bytes: 40,
///     max_shares: 16,
///     loss: Loss { chance: 0.1, burst: 4.0 },
///     user: None,
/// };
/// let mut sender = Sender::new(SenderOptions {
///     control,
///     stream: 0,
///     protection: Protection::Layers,
///     expect_reports: false,
/// })?;
/// for frame in 0..30 {
///     let now = f64::from(frame) / 15.0;
///     if let Some(bytes) = sender.plan(now)? {
///         let packet = encode(bytes); // with Rate::Bytes
///         sender.push(now + 0.1, &packet, None)?;
///     }
///     while let Some((_, share)) = sender.next(now) {
///         send(share);
///     }
/// }
/// # Ok(()) }
/// ```
pub struct Sender {
    options: SenderOptions,
    way: Way,
    sharer: Sharer,
    interleaver: Interleaver,
    /// Shares that may wait.
    room: usize,
    /// The frames that are to come, the earlier one first.
    planned: [Option<PlannedFrame>; 2],
    /// Modem frames are pulled.
    is_pulled: bool,
    /// Bytes of the last packet's truth map.
    told: usize,
    /// Frame number of the last packet, to complete those of packets that state it in part.
    last: Option<u32>,
    history: Option<History>,
    keyed: Option<Keyed>,
    statistics: SenderStatistics,
}

/// How packets become shares, and at which rate.
enum Way {
    Layers(RateControl),
    /// `None`: packets go as they come.
    Unprotected(Unprotected, Option<RateControl>),
}

impl Way {
    fn control(&self) -> Option<&RateControl> {
        match self {
            Way::Layers(control) => Some(control),
            Way::Unprotected(_, control) => control.as_ref(),
        }
    }

    fn control_mut(&mut self) -> Option<&mut RateControl> {
        match self {
            Way::Layers(control) => Some(control),
            Way::Unprotected(_, control) => control.as_mut(),
        }
    }
}

/// A frame that is to be sent.
#[derive(Clone, Copy)]
struct PlannedFrame {
    /// Bytes on the link.
    budget: usize,
    /// When it was exposed, seconds.
    exposed: f64,
}

/// What a sender made of a report.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ProcessedReport {
    /// Shares that were lost, as a part of those that no report told of before; `None`: too few to tell. An unprotected
    /// packet whose start is lost counts as lost as a whole.
    pub loss: Option<f64>,
    /// Shares that are sent again.
    pub shares: usize,
    /// Bytes of them on the link, the overhead of each counted.
    pub bytes: usize,
}

/// Part of the loss before in what is believed after a report.
const MEMORY: f64 = 0.7;
/// Greatest loss that packets are protected against.
const MAX_LOSS: f64 = 0.9;

impl Sender {
    /// Allocates [`SenderOptions::memory`].
    ///
    /// # Errors
    /// If an option is outside its range, or the system does not have the memory.
    pub fn new(options: SenderOptions) -> Result<Sender, ModemError> {
        let (way, room, max) = (options.way()?, options.waiting(), options.max_shares());
        let RateControlOptions { mtu, spread, .. } = options.control;
        Ok(Sender {
            sharer: match options.protection {
                Protection::None => Sharer::with_room_unprotected(mtu, max)?,
                Protection::Layers => Sharer::with_room(mtu, max)?,
            },
            interleaver: Interleaver::with_room(spread, room, mtu)?,
            room,
            planned: [None; 2],
            is_pulled: false,
            told: 0,
            last: None,
            history: options.expect_reports.then(|| History::new(&options.control)).transpose()?,
            keyed: None,
            statistics: SenderStatistics::default(),
            options,
            way,
        })
    }

    /// As [`Sender::new`]. Each modem frame gets a number and a tag by these keys, [`Keys::overhead`] bytes, which
    /// pictures then do not get. Read reports with [`Sender::read_report`]. Allocates
    /// [`SenderOptions::memory_with_keys`].
    ///
    /// # Errors
    /// As [`Sender::new`], or if the MTU has no room for tags.
    pub fn with_keys(options: SenderOptions, keys: &Keys) -> Result<Sender, ModemError> {
        let mut sender = Sender::new(options.keyed(keys)?)?;
        sender.keyed = Some(Keyed::new(keys, options.control.mtu)?);
        Ok(sender)
    }

    /// Bytes for the packet of the frame exposed at `now`, seconds: encode it with
    /// [`Rate::Bytes`](nvsprior::Rate::Bytes).
    /// `None`: the frame is left out, as the link has no bytes for it. Times must not fall. Without a bit rate it is
    /// the longest packet that can be sent.
    ///
    /// # Errors
    /// If the time is not finite.
    pub fn plan(&mut self, now: f64) -> Result<Option<usize>, ModemError> {
        while self.drop_plan() {}
        self.plan_another(now)
    }

    /// As [`Sender::plan`], while the frame planned before is still coded. Packets come in the order of plans.
    ///
    /// # Errors
    /// As [`Sender::plan`].
    pub fn plan_another(&mut self, now: f64) -> Result<Option<usize>, ModemError> {
        check_time(now)?;
        let budget = match self.way.control_mut() {
            Some(control) => control.plan_another(now),
            None => return Ok(Some(self.longest())),
        };
        Ok(self.planned(now, budget))
    }

    /// As [`Sender::plan_another`], for so many modem frames of at most `most` bytes, whatever the rate says: modem
    /// frames are pulled from here on, those of the newest packet first. Without protection the topside knows the MTU,
    /// so they have that.
    ///
    /// # Errors
    /// As [`Sender::plan`].
    pub fn plan_frames(
        &mut self,
        now: f64,
        frames: usize,
        most: usize,
    ) -> Result<Option<usize>, ModemError> {
        check_time(now)?;
        self.is_pulled = true;
        let RateControlOptions { mtu, overhead, max_shares, .. } = self.options.control;
        let tag = self.keyed.as_ref().map_or(0, Keyed::overhead);
        let most = match self.way {
            Way::Layers(_) => most.saturating_sub(tag).clamp(MIN_CHECKED_MTU, mtu),
            Way::Unprotected(..) => mtu,
        };
        let budget = frames.saturating_mul(most.saturating_add(overhead));
        match self.way.control_mut() {
            Some(control) => control.allow(budget, most, frames.min(max_shares)),
            None => return Ok(Some(self.longest())),
        }
        Ok(self.planned(now, Some(budget)))
    }

    /// The longest packet that can be sent without a rate.
    fn longest(&self) -> usize {
        match &self.way {
            Way::Unprotected(link, _) => link.longest(self.options.max_shares()),
            Way::Layers(_) => 0,
        }
    }

    /// Notes a frame's budget. Returns how long its packet may be.
    fn planned(&mut self, exposed: f64, budget: Option<usize>) -> Option<usize> {
        let told = self.told;
        let planned = budget.and_then(|budget| {
            let capacity = match &self.way {
                Way::Unprotected(link, _) => link.capacity(budget)?,
                Way::Layers(control) => control.capacity_told(budget, told).ok()?,
            };
            Some((PlannedFrame { budget, exposed }, capacity))
        });
        match planned {
            Some((frame, _)) => self.planned[usize::from(self.planned[0].is_some())] = Some(frame),
            None => {
                if let (Some(_), Some(control)) = (budget, self.way.control_mut()) {
                    control.drop_last_plan();
                }
                self.statistics.left_out += 1;
            }
        }
        planned.map(|(_, capacity)| capacity)
    }

    /// Drops the earlier of the frames that were planned: no packet comes of it. `false`: none was.
    pub fn drop_plan(&mut self) -> bool {
        let [first, second] = self.planned;
        self.planned = [second, None];
        let dropped = self.way.control_mut().is_some_and(RateControl::drop_plan);
        first.is_some() || dropped
    }

    /// Takes the packet of the frame that was planned first, and the user bytes that travel with it. It is ready at
    /// `now`, seconds. Returns how it is divided.
    ///
    /// A packet that also tells the camera may be longer than planned. It takes more of the link for once. Of a packet
    /// that is still longer, the end is not sent: [`Division::packet_bytes`] tells. Without a bit rate no packet needs
    /// a plan, and all of it is sent.
    ///
    /// # Errors
    /// If no frame was planned, or its packet was taken already. If the bytes are not exactly one packet whose checks
    /// match. If the user bytes are not as many as the options say. If all shares together do not hold a picture. If
    /// too many shares wait, as nobody takes them. Nothing is sent then, and the plan stays.
    pub fn push(
        &mut self,
        now: f64,
        packet: &[u8],
        user: Option<&[u8]>,
    ) -> Result<Division, ModemError> {
        check_time(now)?;
        let user_len = user.map(<[u8]>::len);
        if user_len != self.options.control.user {
            return Err(ModemError::UserBytes(user_len.unwrap_or(0)));
        }
        let (division, exposed, number) = self.make_shares(packet, user)?;
        self.planned = [self.planned[1], None];
        if let Some(control) = self.way.control_mut() {
            control.sent(now, division.link_bytes);
        }
        match self.is_pulled {
            // The newest first, then what is left of the one before.
            true => {
                let newest = -(self.statistics.packets as f64);
                self.interleaver.drop_after(newest + 1.0);
                self.interleaver.push(newest, &self.sharer);
            }
            false => self.interleaver.push(now, &self.sharer),
        }
        let frame = nearest_frame(number, Latent::FRAMES, self.last);
        self.last = Some(frame);
        if let Some(history) = &mut self.history {
            let spread = self.options.control.spread;
            let wanted = match self.way {
                Way::Layers(_) => division.picture_shares,
                Way::Unprotected(..) => division.shares,
            };
            history.add(frame, [exposed, now, spread], wanted, &self.sharer);
        }
        self.statistics.packets += 1;
        self.statistics.cut += u64::from(division.packet_bytes < packet.len());
        self.statistics.shares += division.shares as u64;
        self.statistics.bytes += division.link_bytes as u64;
        Ok(division)
    }

    /// What of packets travels.
    fn travelling(&self) -> Travelling {
        match &self.way {
            Way::Layers(_) => Travelling::Wide,
            Way::Unprotected(link, _) => link.layout.travelling(),
        }
    }

    /// Divides a packet, and makes its shares if there is room for them. Tells when its frame was exposed, and the
    /// number that it states.
    fn make_shares(
        &mut self,
        packet: &[u8],
        user: Option<&[u8]>,
    ) -> Result<(Division, f64, u32), ModemError> {
        let unpaced = self.way.control().is_none();
        let plan = self.planned[0].or(unpaced.then_some(PlannedFrame { budget: 0, exposed: 0.0 }));
        let PlannedFrame { budget, exposed } = plan.ok_or(ModemError::NotPlanned)?;
        let Extent { frame, head, told, .. } = Extent::read(packet)?;
        let left_out = self.travelling().left_out(packet[0]).len();
        let (picture, len) = (head - left_out, packet.len() - left_out);
        let waiting = self.interleaver.len();
        let check_room = |shares: usize| match waiting + shares {
            waiting if waiting > self.room => Err(ModemError::Waiting { waiting, room: self.room }),
            _ => Ok(()),
        };
        let division = match &self.way {
            Way::Layers(control) => {
                let sharing = match control.divide_told(budget, (picture, told), len) {
                    Some(sharing) => sharing,
                    None => control.divide_longer(budget, picture, len)?.0,
                };
                check_room(sharing.count())?;
                self.sharer.share(packet, &sharing, self.options.stream, user)?;
                Division::of(&sharing, len, control.cost(&sharing))
            }
            Way::Unprotected(link, control) => {
                let division = match control {
                    Some(_) => link.divide(budget, picture, len)?,
                    None => link.whole(picture, len)?,
                };
                check_room(division.shares)?;
                self.sharer.split_start(packet, link.layout, division.shares)?;
                division
            }
        };
        self.told = told;
        let packet_bytes = division.packet_bytes + left_out;
        Ok((Division { packet_bytes, left_out, ..division }, exposed, frame))
    }

    /// Reads a report for [`Sender::process_report`], and the user bytes that came with it. With keys only one that the
    /// topside has made with them passes, and none a second time.
    ///
    /// # Errors
    /// As [`Report::read`]. With keys, if the report is not the topside's.
    pub fn read_report<'a>(
        &mut self,
        bytes: &'a [u8],
    ) -> Result<(Report, Option<&'a [u8]>), ModemError> {
        let Some(keyed) = &mut self.keyed else { return Report::read(bytes) };
        match keyed.verifier.verify(bytes) {
            Ok(verified) => Report::read(verified.content),
            Err(refusal) => {
                match refusal {
                    Refusal::Foreign => self.statistics.foreign += 1,
                    Refusal::Replayed => self.statistics.replayed += 1,
                }
                Err(refusal.into())
            }
        }
    }

    /// Number of the next modem frame; `None`: there are no keys. See [`Keys::with_number`].
    pub fn next_number(&self) -> Option<u64> {
        Some(self.keyed.as_ref()?.authenticator.next_number())
    }

    /// The reports that were taken so far, with keys. See [`Keys::with_seen`].
    pub fn seen(&self) -> impl Iterator<Item = Seen> + '_ {
        self.keyed.iter().flat_map(|keyed| keyed.verifier.seen())
    }

    /// Takes a report that came at `now`, seconds. The protection follows the loss that it tells, step by step. Shares
    /// that a picture still lacks are sent again, once, if they come within the latency; they are due at once. Without
    /// protection that is all shares that are missing. [`Report::packets`] tells which frames later ones may be
    /// predicted from: see [`Encoder::acknowledge`](nvsprior::Encoder::acknowledge).
    ///
    /// # Errors
    /// If the time is not finite, the report is about another stream, or the sender was made without
    /// [`SenderOptions::expect_reports`]. Nothing changes then.
    pub fn process_report(
        &mut self,
        now: f64,
        report: &Report,
    ) -> Result<ProcessedReport, ModemError> {
        check_time(now)?;
        let (found, expected) = (report.stream(), self.options.stream);
        if found != expected {
            return Err(ModemError::ReportStream { found, expected });
        }
        let (Some(history), Some(control)) = (&mut self.history, self.way.control_mut()) else {
            return Err(ModemError::NoReports);
        };
        let mut processed = ProcessedReport { loss: history.loss(report), ..Default::default() };
        let RateControlOptions { bit_rate, latency, delay, overhead, loss, .. } =
            *control.options();
        if let Some(measured) = processed.loss {
            let chance = MEMORY * loss.chance + (1.0 - MEMORY) * measured;
            control.set_loss(Loss { chance: chance.min(MAX_LOSS), ..loss })?;
        }
        loop {
            let (room, waiting) = (self.room, self.interleaver.len());
            let on_link = |count: usize, len: usize| count * (len + overhead);
            let in_time = |count: usize, len: usize, exposed: f64| {
                let seconds = on_link(count, len) as f64 * 8.0 / bit_rate;
                now + seconds + delay <= exposed + latency && waiting + count <= room
            };
            let Some(missing) = history.next_to_resend(report, in_time) else {
                return Ok(processed);
            };
            for share in missing {
                self.interleaver.push_share(now, share);
                processed.shares += 1;
                processed.bytes += on_link(1, share.len());
                control.count(now, on_link(1, share.len()));
                self.statistics.resent += 1;
            }
        }
    }

    /// The next modem frame, if it is due at `now`: the time at which it was, and the frame. Those that could not be
    /// sent in time are due still.
    pub fn next(&mut self, now: f64) -> Option<(f64, &[u8])> {
        let (due, frame) = self.interleaver.next(now)?;
        let stream = self.options.stream;
        Some((due, self.keyed.as_mut().map_or(frame, |keyed| keyed.authenticate(stream, frame))))
    }

    /// Bytes of the next modem frame, if it is due at `now`.
    pub fn next_len(&self, now: f64) -> Option<usize> {
        let overhead = self.keyed.as_ref().map_or(0, Keyed::overhead);
        Some(self.interleaver.next_len(now)? + overhead)
    }

    /// The next modem frame, whenever it is due, if it has at most so many bytes.
    pub fn pull(&mut self, most: usize) -> Option<&[u8]> {
        self.next_len(f64::INFINITY).filter(|len| *len <= most)?;
        Some(self.next(f64::INFINITY)?.1)
    }

    /// Bytes of the modem frames that wait of the newest packet that is pulled, with what they cost on the link.
    pub fn pulled_bytes(&self) -> usize {
        let newest = 1.0 - self.statistics.packets as f64;
        let overhead = self.options.control.overhead;
        let own = self.interleaver.waiting().filter(|(due, _)| *due <= newest);
        own.map(|(_, len)| len.saturating_add(overhead)).sum()
    }

    /// Most bytes of a modem frame, its tag counted.
    pub fn mtu(&self) -> usize {
        self.options.control.mtu + self.keyed.as_ref().map_or(0, Keyed::overhead)
    }

    /// When the next modem frame is due, seconds. `None`: none waits.
    pub fn due(&self) -> Option<f64> {
        self.interleaver.due()
    }

    /// Shares that wait, due or not.
    pub fn waiting(&self) -> usize {
        self.interleaver.len()
    }

    /// The shares of the packet that was taken last, without the tags that keys give them.
    pub fn shares(&self) -> &Sharer {
        &self.sharer
    }

    /// Counts bytes that are given to the link at `now` besides: shares that are sent again, telemetry.
    ///
    /// # Errors
    /// If the time is not finite.
    pub fn count(&mut self, now: f64, bytes: usize) -> Result<(), ModemError> {
        check_time(now)?;
        if let Some(control) = self.way.control_mut() {
            control.count(now, bytes);
        }
        Ok(())
    }

    /// The link carries another bit rate from `now` on: see [`RateControl::set_bit_rate`].
    ///
    /// # Errors
    /// If the rate is not positive and finite, or the time not finite. The rate before stays. If the sender was made
    /// without a bit rate.
    pub fn set_bit_rate(&mut self, now: f64, bit_rate: f64) -> Result<(), ModemError> {
        check_time(now)?;
        self.way.control_mut().ok_or(ModemError::Unpaced)?.set_bit_rate(now, bit_rate)
    }

    /// So many frames per second come from here on: see [`RateControl::set_frame_rate`].
    ///
    /// # Errors
    /// If the frame rate is not positive and finite. The one before stays. If the sender was made without a bit rate.
    pub fn set_frame_rate(&mut self, frame_rate: f64) -> Result<(), ModemError> {
        self.way.control_mut().ok_or(ModemError::Unpaced)?.set_frame_rate(frame_rate)
    }

    /// The link's loss, as it was measured: packets from here on are protected against it.
    ///
    /// # Errors
    /// If it is outside its range. The one before stays. If the sender was made without a bit rate.
    pub fn set_loss(&mut self, loss: Loss) -> Result<(), ModemError> {
        self.way.control_mut().ok_or(ModemError::Unpaced)?.set_loss(loss)
    }

    /// What the link is taken for, with rate and loss as they are now. With keys, MTU and overhead are those of what
    /// stands behind a tag.
    pub fn options(&self) -> &RateControlOptions {
        self.way.control().map_or(&self.options.control, RateControl::options)
    }

    /// What was sent so far.
    pub fn statistics(&self) -> SenderStatistics {
        self.statistics
    }
}

fn check_time(now: f64) -> Result<(), ModemError> {
    if now.is_finite() { Ok(()) } else { Err(ModemError::Time(now)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::modem::collect::collected::Collected;
    use crate::modem::collect::collector::{Collector, CollectorOptions};
    use crate::modem::tests::{Recipe, packet_of};
    use nvsprior::packet::{Packet, PoseProfile, Residual, SHORT_LATENT_LEN};
    use nvsprior::random::Random;

    fn options() -> SenderOptions {
        let control = RateControlOptions {
            bit_rate: 20_000.0,
            mtu: 64,
            overhead: 0,
            latency: 1.5,
            delay: 0.2,
            spread: 0.5,
            frame_rate: 15.0,
            min_bytes: 40,
            max_shares: 16,
            loss: Loss { chance: 0.2, burst: 1.0 },
            user: None,
        };
        SenderOptions { control, stream: 1, protection: Protection::Layers, expect_reports: false }
    }

    /// A packet of at most so many bytes.
    fn packet(frame: u32, bytes: usize) -> Vec<u8> {
        let payload = Some(bytes - SHORT_LATENT_LEN - 2);
        let profile = PoseProfile::Short;
        packet_of(Recipe { frame, profile, stated: false, payload })
    }

    #[test]
    fn what_comes_over_a_lossy_link_is_shown() {
        let mut sender = Sender::new(options()).unwrap();
        let options = CollectorOptions { streams: 2, ..CollectorOptions::new(64) };
        let mut collector = Collector::new(options).unwrap();
        let mut random = Random::new(1);
        let (mut shown, mut sent, mut free) = (0, 0, 0.0);
        for frame in 0..900 {
            let now = f64::from(frame) / 15.0;
            if let Some(bytes) = sender.plan(now).unwrap() {
                let packet = packet(frame, bytes);
                let division = sender.push(now, &packet, None).unwrap();
                assert_eq!(division.packet_bytes, packet.len());
                sent += 1;
            }
            // The modem takes a share when it is free.
            while sender.due().is_some_and(|due| due <= now && free <= now) {
                let (due, share) = sender.next(now).unwrap();
                free = f64::max(free, due) + share.len() as f64 * 8.0 / 20_000.0;
                if random.within(0.0, 1.0) >= 0.2 {
                    let pushed = collector.push(now, share).unwrap();
                    shown += u32::from(matches!(pushed, Collected::Complete(1, _)));
                }
            }
        }
        let statistics = sender.statistics();
        assert_eq!(statistics.packets, sent);
        assert!(sent >= 890 && statistics.left_out + sent == 900, "{statistics:?}");
        assert!((145_000..=150_500).contains(&statistics.bytes), "{statistics:?}");
        assert!(shown > 650, "{shown} {:?}", collector.statistics());
    }

    /// Sends so many frames over a link that loses shares by chance. The topside reports every second, and the report
    /// comes `delay` later. Pictures that came in time, and the sender.
    fn run(frames: u32, chance: f32, delay: Option<f64>) -> (usize, Sender) {
        let control = RateControlOptions {
            latency: 2.5,
            delay: 0.1,
            loss: Loss { chance: 0.05, burst: 1.0 },
            ..options().control
        };
        let expect_reports = delay.is_some();
        let mut sender =
            Sender::new(SenderOptions { control, expect_reports, ..options() }).unwrap();
        let collector = CollectorOptions { streams: 2, packets: 64, ..CollectorOptions::new(64) };
        let mut collector = Collector::new(collector).unwrap();
        let mut random = Random::new(7);
        let mut reports: Vec<(f64, Vec<u8>)> = Vec::new();
        let mut shown = std::collections::BTreeSet::new();
        for frame in 0..frames {
            let now = f64::from(frame) / 15.0;
            if let Some(bytes) = sender.plan(now).unwrap() {
                sender.push(now, &packet(frame, bytes), None).unwrap();
            }
            while let Some((_, share)) = sender.next(now) {
                if random.within(0.0, 1.0) < chance {
                    continue;
                }
                let pushed = collector.push(now, share).unwrap();
                if let Collected::Complete(1, number) | Collected::Grown(1, number) = pushed
                    && f64::from(number) / 15.0 + 2.5 >= now
                {
                    shown.insert(number);
                }
            }
            let Some(delay) = delay else { continue };
            if frame % 15 == 14
                && let Some(report) = collector.report(1, |_| false).unwrap()
            {
                let mut bytes = vec![0; 200];
                let len = report.write(None, &mut bytes).unwrap();
                reports.push((now + delay, bytes[..len].to_vec()));
            }
            while reports.first().is_some_and(|(time, _)| *time <= now) {
                let (report, _) = Report::read(&reports.remove(0).1).map(|(r, _)| (r, ())).unwrap();
                sender.process_report(now, &report).unwrap();
            }
        }
        (shown.len(), sender)
    }

    #[test]
    fn reports_bring_back_pictures_and_tell_the_loss() {
        let (without, deaf) = run(450, 0.4, None);
        let (with, sender) = run(450, 0.4, Some(0.2));
        assert_eq!(deaf.statistics().resent, 0);
        assert!(sender.statistics().resent > 10, "{:?}", sender.statistics());
        assert!(with > without + 20, "{with} and {without} pictures");
        let believed = sender.options().loss.chance;
        assert!((0.3..0.5).contains(&believed), "{believed}");
        // No loss, nothing to send again.
        let (all, sender) = run(150, 0.0, Some(0.2));
        // The shares of the last half second wait still.
        let statistics = sender.statistics();
        assert!(all as u64 + 8 >= statistics.packets, "{all} {statistics:?}");
        assert_eq!(statistics.resent, 0);
        assert!(sender.options().loss.chance < 0.02);
    }

    fn unprotected(bit_rate: f64, expect_reports: bool) -> Result<Sender, ModemError> {
        let control =
            RateControlOptions { bit_rate, max_shares: 64, latency: 2.5, ..options().control };
        let protection = Protection::None;
        Sender::new(SenderOptions { control, stream: 0, protection, expect_reports })
    }

    /// One modem frame in ten is lost. Those that a report misses come again.
    #[test]
    fn without_protection_what_is_missing_comes_again() {
        let mut sender = unprotected(20_000.0, true).unwrap();
        let collector = CollectorOptions { packets: 64, ..CollectorOptions::new(64) };
        let mut collector = Collector::new(collector).unwrap();
        let (mut random, mut losses) = (Random::new(3), Vec::new());
        for frame in 0..300 {
            let now = f64::from(frame) / 15.0;
            if let Some(bytes) = sender.plan(now).unwrap() {
                let packet = packet(frame, bytes);
                let division = sender.push(now, &packet, None).unwrap();
                assert_eq!(division.link_bytes, packet.len() + 1 + 4 * (division.shares - 1));
            }
            while let Some((_, share)) = sender.next(now) {
                if random.within(0.0, 1.0) >= 0.1 {
                    collector.push(now, share).unwrap();
                }
            }
            if frame % 8 == 7
                && let Some(report) = collector.report(0, |_| false).unwrap()
            {
                losses.extend(sender.process_report(now, &report).unwrap().loss);
            }
        }
        let (sent, came) = (sender.statistics(), collector.statistics());
        // The link carries 50,000 bytes, those that come again among them.
        let bytes = sent.bytes + sent.resent * 64;
        assert!(sent.bytes > 40_000 && bytes < 52_000, "{sent:?}");
        // A packet whose start is lost counts as lost as a whole: nothing tells of what its other shares are.
        let loss = losses.iter().sum::<f64>() / losses.len() as f64;
        assert!((0.1..0.2).contains(&loss), "{loss}");
        // Some of what comes again is lost again, and the last packets are still on their way.
        assert!(sent.resent > 50 && sent.cut == 0 && came.completed + 35 > sent.packets);
    }

    #[test]
    fn without_a_rate_packets_go_as_they_come() {
        let mut sender = unprotected(0.0, false).unwrap();
        let max = 62 + 63 * 60 + 1;
        assert_eq!(sender.plan(0.0), Ok(Some(max)));
        let packet = packet(7, max);
        for _ in 0..3 {
            let shares = sender.push(0.0, &packet, None).unwrap().shares;
            let sent = std::iter::from_fn(|| sender.next(9.0).map(|(_, share)| share.len()));
            assert_eq!(sent.sum::<usize>(), packet.len() + 1 + 4 * (shares - 1));
        }
        assert_eq!(sender.set_bit_rate(0.0, 5000.0), Err(ModemError::Unpaced));
        assert_eq!(unprotected(0.0, true).map(drop), Err(ModemError::UnpacedReports));
        let of = |stream, user| {
            let control = RateControlOptions { bit_rate: 0.0, user, ..options().control };
            let protection = Protection::None;
            let expect_reports = false;
            Sender::new(SenderOptions { control, stream, protection, expect_reports })
        };
        assert_eq!(of(1, None).map(drop), Err(ModemError::UnprotectedStream(1)));
        assert_eq!(of(0, Some(3)).map(drop), Err(ModemError::UserBytes(3)));
    }

    #[test]
    fn reports_of_others_are_refused() {
        let report = |stream| Report::new(stream, 5, std::iter::empty()).unwrap();
        let mut deaf = Sender::new(options()).unwrap();
        assert_eq!(deaf.process_report(0.0, &report(1)), Err(ModemError::NoReports));
        let mut sender = Sender::new(SenderOptions { expect_reports: true, ..options() }).unwrap();
        assert_eq!(sender.process_report(0.0, &report(1)), Ok(ProcessedReport::default()));
        let other = ModemError::ReportStream { found: 2, expected: 1 };
        assert_eq!(sender.process_report(0.0, &report(2)), Err(other));
        assert_eq!(sender.process_report(f64::NAN, &report(1)).map_err(|_| ()), Err(()));
    }

    #[test]
    fn a_packet_with_the_camera_takes_more_for_once() {
        let tight =
            RateControlOptions { bit_rate: 12_000.0, frame_rate: 30.0, ..options().control };
        let mut sender = Sender::new(SenderOptions { control: tight, ..options() }).unwrap();
        sender.plan(0.0).unwrap().unwrap();
        let (profile, payload) = (PoseProfile::Compact, Some(300));
        let long = packet_of(Recipe { frame: 0, profile, stated: true, payload });
        let division = sender.push(0.0, &long, None).unwrap();
        assert!((49..long.len()).contains(&division.packet_bytes), "{division:?}");
        assert_eq!(sender.statistics().cut, 1);
        let after = (1..30).find(|frame| sender.plan(f64::from(*frame) / 30.0).unwrap().is_some());
        assert!(after > Some(1), "the next frames pay for it");
    }

    /// A packet of at most so many bytes with a truth map.
    fn packet_with_map(frame: u32, bytes: usize) -> Vec<u8> {
        let map = [0b01, 6, 1, 2, 3, 4, 5, 6];
        let bare = packet(frame, bytes - map.len());
        let bare = Packet::decode(&bare).unwrap();
        let Residual::Coded { payload, .. } = bare.residual else { panic!("{bare:?}") };
        let residual = Residual::Coded { small_blocks: false, payload };
        Packet { residual, truth: Some(&map), ..bare }.encode().unwrap()
    }

    #[test]
    fn the_truth_map_comes_with_the_picture() {
        let mut layers = 0;
        for (chance, bit_rate) in [(0.01, 8e3), (0.1, 2e4), (0.01, 12e4), (0.05, 12e4)] {
            let loss = Loss { chance, burst: 1.0 };
            let control = RateControlOptions { bit_rate, loss, ..options().control };
            let mut sender = Sender::new(SenderOptions { control, ..options() }).unwrap();
            for frame in 0..30 {
                let now = f64::from(frame) / 15.0;
                let Some(planned) = sender.plan(now).unwrap() else { continue };
                let packet = packet_with_map(frame, planned);
                let Extent { head, told, .. } = Extent::read(&packet).unwrap();
                assert!(packet.len() <= planned && told > 8);
                let division = sender.push(now, &packet, None).unwrap();
                // Before the first packet it is not known that there is a map.
                if frame == 0 {
                    continue;
                }
                assert!(division.packet_bytes >= packet.len(), "{division:?}");
                let options = CollectorOptions { streams: 2, ..CollectorOptions::new(64) };
                let mut collector = Collector::new(options).unwrap();
                for share in sender.shares().shares().take(division.picture_shares) {
                    collector.push(now, share).unwrap();
                }
                let there = collector.packet(1, frame).unwrap().bytes.len();
                assert!(there >= head + told, "{there} of {}: {division:?}", head + told);
                layers += usize::from(there < packet.len());
            }
        }
        assert!(layers > 0, "some have a layer of their own for the difference picture");
    }

    #[test]
    fn if_a_packet_takes_all_shares_one_with_the_camera_is_not_cut() {
        let control = RateControlOptions { bit_rate: 1e6, ..options().control };
        let mut sender = Sender::new(SenderOptions { control, ..options() }).unwrap();
        let planned = sender.plan(0.0).unwrap().unwrap();
        let recipe = |stated, payload| {
            let profile = PoseProfile::Compact;
            packet_of(Recipe { frame: 0, profile, stated, payload: Some(payload) })
        };
        let fits = |payload: &usize| recipe(false, *payload).len() <= planned;
        let longer = recipe(true, (0..planned).rev().find(fits).unwrap());
        assert!(longer.len() > planned);
        let division = sender.push(0.0, &longer, None).unwrap();
        assert_eq!(division.packet_bytes, longer.len());
        assert_eq!(division.shares, sender.options().max_shares);
    }

    #[test]
    fn a_packet_needs_a_plan_and_a_refused_one_leaves_it() {
        let mut sender = Sender::new(options()).unwrap();
        let one = packet(0, 100);
        assert_eq!(sender.push(0.0, &one, None), Err(ModemError::NotPlanned));
        sender.plan(0.0).unwrap().unwrap();
        assert_eq!(sender.push(0.0, &one, Some(&[1])), Err(ModemError::UserBytes(1)));
        assert!(sender.push(0.0, &one[..50], None).is_err());
        assert_eq!((sender.waiting(), sender.statistics().packets), (0, 0));
        sender.push(0.0, &one, None).unwrap();
        assert_eq!(sender.push(0.0, &one, None), Err(ModemError::NotPlanned));
        assert_eq!(sender.waiting(), sender.shares().count());
    }

    #[test]
    fn if_nobody_takes_the_shares_packets_are_refused() {
        let mut sender = Sender::new(options()).unwrap();
        let refused = (0..10_000).find_map(|frame| {
            let bytes = sender.plan(f64::from(frame) / 15.0).unwrap()?;
            sender.push(0.0, &packet(frame, bytes), None).err()
        });
        assert!(matches!(refused, Some(ModemError::Waiting { .. })), "{refused:?}");
        let waiting = sender.waiting();
        assert!(waiting * 64 <= options().memory().unwrap());
        assert_eq!(std::iter::from_fn(|| sender.next(1e6).map(drop)).count(), waiting);
        assert_eq!(sender.due(), None);
    }

    #[test]
    fn times_and_options_are_checked() {
        let mut sender = Sender::new(options()).unwrap();
        for now in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert!(sender.plan(now).is_err() && sender.count(now, 5).is_err());
            assert!(sender.push(now, &packet(0, 100), None).is_err());
            assert!(sender.set_bit_rate(now, 5.0).is_err());
        }
        assert!(sender.set_bit_rate(0.0, f64::NAN).is_err());
        assert!(sender.set_loss(Loss { chance: 1.5, burst: 1.0 }).is_err());
        assert!(Sender::new(SenderOptions { stream: 4, ..options() }).is_err());
        let control = RateControlOptions { max_shares: 257, ..options().control };
        assert!(Sender::new(SenderOptions { control, expect_reports: true, ..options() }).is_err());
        // No number makes it panic.
        for value in [1e-300, 1e300, f64::MAX, f64::MIN_POSITIVE] {
            for field in 0..4 {
                let mut control = options().control;
                match field {
                    0 => control.bit_rate = value,
                    1 => control.frame_rate = value,
                    2 => control.latency = control.latency.max(value),
                    _ => control.spread = control.spread.min(value),
                }
                for overhead in [0, usize::MAX] {
                    control.overhead = overhead;
                    let Ok(mut sender) =
                        Sender::new(SenderOptions { control, expect_reports: true, ..options() })
                    else {
                        continue;
                    };
                    for now in [-1e300, 0.0, 1.0, 1e300] {
                        let _ = sender.plan(now);
                        let _ = sender.push(now, &packet(3, 90), None);
                        let _ = sender.next(now);
                    }
                }
            }
        }
    }
}
