//! The vehicle's end of a link: how many bytes a frame may take, its packet to shares, and when each share goes.

use crate::packet::Extent;

use super::history::History;
use super::shares::{MAX_SHARES, STREAMS};
use super::{
    Interleaver, Loss, ModemError, RateControl, RateControlOptions, Report, Sharer, Sharing,
};

/// How a sender uses its link.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SenderOptions {
    /// The link, and what its pictures should be.
    pub control: RateControlOptions,
    /// The stream that the packets are of, 0 to 3.
    pub stream: u8,
    /// The topside answers with reports: [`Sender::hear`]. The sender then remembers what it sent.
    pub answers: bool,
}

impl SenderOptions {
    /// Shares that may wait: those of the packets that come within the latency, at three times the frame rate, and no more
    /// than the link carries in that time.
    fn waiting(&self) -> usize {
        let RateControlOptions { bit_rate, overhead, latency, delay, frame_rate, .. } =
            self.control;
        let most = self.control.most_shares.min(MAX_SHARES);
        let packets = 3.0 * (latency - delay) * frame_rate;
        let carried =
            bit_rate / 8.0 * (latency - delay) / LEAST_SHARE.saturating_add(overhead) as f64;
        let shares = (packets * most as f64).min(carried) as usize;
        shares.saturating_add(4 * most).min(MOST_WAITING)
    }

    /// Checks the options, and makes the rate control of them.
    fn control(&self) -> Result<RateControl, ModemError> {
        if self.stream >= STREAMS {
            return Err(ModemError::Stream(self.stream));
        }
        RateControl::new(self.control)
    }

    /// Memory that a [`Sender`] takes at most, all of it when it is made, bytes.
    ///
    /// # Errors
    /// If an option is outside its range.
    pub fn memory(&self) -> Result<usize, ModemError> {
        self.control()?;
        let RateControlOptions { mtu, most_shares, .. } = self.control;
        let shares = self.waiting() + 3 * most_shares.min(MAX_SHARES) + 2;
        let waiting = shares.saturating_mul(mtu.saturating_add(LIST));
        let history = if self.answers { History::memory(&self.control) } else { 0 };
        Ok(waiting.saturating_add(history))
    }
}

/// What a share takes beside its own bytes: its places in the lists, and the heap's own.
const LIST: usize = 96;
/// Least bytes of a share.
const LEAST_SHARE: usize = 8;
/// Shares that wait at most, whatever the options are.
const MOST_WAITING: usize = 1 << 16;

/// Counts since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SenderStatistics {
    /// Frames that were left out: [`Sender::plan`] had no bytes for them.
    pub left_out: u64,
    /// Packets that were shared.
    pub packets: u64,
    /// Packets of them whose end was not sent, as they were longer than planned.
    pub cut: u64,
    /// Shares of them.
    pub shares: u64,
    /// Bytes of them on the link, the overhead of each share counted.
    pub bytes: u64,
    /// Shares that were sent again.
    pub resent: u64,
}

/// Takes a vehicle's packets, and gives the modem frames to send: rate control, [`Sharer`] and [`Interleaver`] in one.
///
/// For each frame ask for its bytes, encode it in as many, and give the packet. Whenever the modem is free, send the next
/// share that is due. Nothing is allocated after [`Sender::new`].
///
/// ```
/// # fn main() -> Result<(), nvsprior::modem::ModemError> {
/// # let send = |share: &[u8]| {};
/// # let encode = |bytes: usize| -> Vec<u8> { vec![
/// #     0xb1, 0x05, 0x04, 0x03, 0x02, 0xed, 0xd0, 0xa5, 0xd4, 0x3f, 0x31, 0x0b, 0x45, 0x13, 0x00,
/// #     0xfc, 0x14, 0xff, 0x6b, 0xe3, 0xf9, 0x94, 0x94, 0x8e, 0x84, 0xa4, 0xa4, 0x24, 0xa8, 0xd9,
/// #     0x61,
/// # ] };
/// use nvsprior::modem::{Loss, RateControlOptions, Sender, SenderOptions};
/// let control = RateControlOptions {
///     bit_rate: 20_000.0,
///     mtu: 64,
///     overhead: 0,
///     latency: 1.5,
///     delay: 0.5,
///     spread: 0.5,
///     frame_rate: 15.0,
///     least: 40,
///     most_shares: 16,
///     loss: Loss { chance: 0.1, burst: 4.0 },
///     user: None,
/// };
/// let mut sender = Sender::new(SenderOptions { control, stream: 0, answers: false })?;
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
    control: RateControl,
    sharer: Sharer,
    interleaver: Interleaver,
    stream: u8,
    /// Shares that may wait.
    room: usize,
    /// The frame that is to come.
    planned: Option<Plan>,
    history: Option<History>,
    statistics: SenderStatistics,
}

/// A frame that is to be sent.
#[derive(Clone, Copy)]
struct Plan {
    /// Bytes on the link.
    budget: usize,
    /// When it was exposed, seconds.
    exposed: f64,
}

/// What a sender made of a report.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Heard {
    /// Shares that were lost, as a part of those that no report told of before; `None`: too few to tell.
    pub loss: Option<f64>,
    /// Shares that are sent again.
    pub shares: usize,
    /// Bytes of them on the link, the overhead of each counted.
    pub bytes: usize,
}

/// Part of the loss before in what is believed after a report.
const MEMORY: f64 = 0.7;
/// Greatest loss that packets are protected against.
const MOST_LOSS: f64 = 0.9;

impl Sender {
    /// Allocates [`SenderOptions::memory`].
    ///
    /// # Errors
    /// If an option is outside its range, or the system does not have the memory.
    pub fn new(options: SenderOptions) -> Result<Sender, ModemError> {
        let (control, room) = (options.control()?, options.waiting());
        let RateControlOptions { mtu, spread, most_shares, .. } = options.control;
        Ok(Sender {
            control,
            sharer: Sharer::with_room(mtu, most_shares)?,
            interleaver: Interleaver::with_room(spread, room, mtu)?,
            stream: options.stream,
            room,
            planned: None,
            history: options.answers.then(|| History::new(&options.control)).transpose()?,
            statistics: SenderStatistics::default(),
        })
    }

    /// Bytes for the packet of the frame exposed at `now`, seconds: encode it with [`Rate::Bytes`](crate::Rate::Bytes).
    /// `None`: the frame is left out, as the link has no bytes for it. Times must not fall.
    ///
    /// # Errors
    /// If the time is not finite.
    pub fn plan(&mut self, now: f64) -> Result<Option<usize>, ModemError> {
        check_time(now)?;
        let bytes = self.control.plan(now).and_then(|budget| {
            let most = self.control.most(budget).ok()?;
            Some((budget, most.capacity()))
        });
        self.planned = bytes.map(|(budget, _)| Plan { budget, exposed: now });
        self.statistics.left_out += u64::from(bytes.is_none());
        Ok(bytes.map(|(_, capacity)| capacity))
    }

    /// Takes the packet of the frame that was planned last, and the user bytes that travel with it. It is ready at `now`,
    /// seconds. Returns how it is divided.
    ///
    /// A packet that also tells the camera may be longer than planned. It takes more of the link for once. Of a packet that
    /// is still longer, the end is not sent: [`Sharing::capacity`] tells.
    ///
    /// # Errors
    /// If no frame was planned, or its packet was taken already. If the bytes are not exactly one packet whose checks match.
    /// If the user bytes are not as many as the options say. If all shares together do not hold a picture. If too many
    /// shares wait, as nobody takes them. Nothing is sent then, and the plan stays.
    pub fn push(
        &mut self,
        now: f64,
        packet: &[u8],
        user: Option<&[u8]>,
    ) -> Result<Sharing, ModemError> {
        check_time(now)?;
        let Plan { budget, exposed } = self.planned.ok_or(ModemError::NotPlanned)?;
        let user_len = user.map(<[u8]>::len);
        if user_len != self.control.options().user {
            return Err(ModemError::UserBytes(user_len.unwrap_or(0)));
        }
        let Extent { head, frame, .. } = Extent::read(packet)?;
        let (sharing, _) = self.control.divide_longer(budget, head, packet.len())?;
        let waiting = self.interleaver.len() + sharing.count();
        if waiting > self.room {
            return Err(ModemError::Waiting { waiting, room: self.room });
        }
        self.sharer.share(packet, &sharing, self.stream, user)?;
        self.planned = None;
        let bytes = self.control.cost(&sharing);
        self.control.sent(now, bytes);
        self.interleaver.push(now, &self.sharer);
        if let Some(history) = &mut self.history {
            let spread = self.control.options().spread;
            history.add(frame, [exposed, now, spread], &sharing, &self.sharer);
        }
        self.statistics.packets += 1;
        self.statistics.cut += u64::from(sharing.capacity() < packet.len());
        self.statistics.shares += sharing.count() as u64;
        self.statistics.bytes += bytes as u64;
        Ok(sharing)
    }

    /// Takes a report that came at `now`, seconds. The protection follows the loss that it tells, step by step. Shares that a
    /// picture still lacks are sent again, once, if they come within the latency; they are due at once.
    /// [`Report::packets`] tells which frames later ones may lean on: see [`Encoder::acknowledge`](crate::Encoder::acknowledge).
    ///
    /// # Errors
    /// If the time is not finite, the report is about another stream, or the sender was made without
    /// [`SenderOptions::answers`]. Nothing changes then.
    pub fn hear(&mut self, now: f64, report: &Report) -> Result<Heard, ModemError> {
        check_time(now)?;
        let (found, expected) = (report.stream(), self.stream);
        if found != expected {
            return Err(ModemError::ReportStream { found, expected });
        }
        let history = self.history.as_mut().ok_or(ModemError::NoAnswers)?;
        let mut heard = Heard { loss: history.loss(report), ..Heard::default() };
        let RateControlOptions { bit_rate, latency, delay, overhead, loss, .. } =
            *self.control.options();
        if let Some(measured) = heard.loss {
            let chance = MEMORY * loss.chance + (1.0 - MEMORY) * measured;
            self.control.set_loss(Loss { chance: chance.min(MOST_LOSS), ..loss })?;
        }
        loop {
            let (room, waiting) = (self.room, self.interleaver.len());
            let on_link = |count: usize, len: usize| count * (len + overhead);
            let in_time = |count: usize, len: usize, exposed: f64| {
                let seconds = on_link(count, len) as f64 * 8.0 / bit_rate;
                now + seconds + delay <= exposed + latency && waiting + count <= room
            };
            let Some(again) = history.next_to_resend(report, in_time) else { return Ok(heard) };
            let shares = again.shares.chunks_exact(again.share_len).zip(again.missing);
            for (share, _) in shares.filter(|(_, missing)| *missing) {
                self.interleaver.push_share(now, share);
                heard.shares += 1;
                heard.bytes += on_link(1, share.len());
                self.control.sent(now, on_link(1, share.len()));
                self.statistics.resent += 1;
            }
        }
    }

    /// The next share, if it is due at `now`: the time at which it was, and the share. Shares that could not be sent in time
    /// are due still.
    pub fn next(&mut self, now: f64) -> Option<(f64, &[u8])> {
        self.interleaver.next(now)
    }

    /// Bytes of the next share, if it is due at `now`.
    pub fn next_len(&self, now: f64) -> Option<usize> {
        self.interleaver.next_len(now)
    }

    /// When the next share is due, seconds. `None`: none waits.
    pub fn due(&self) -> Option<f64> {
        self.interleaver.due()
    }

    /// Shares that wait, due or not.
    pub fn waiting(&self) -> usize {
        self.interleaver.len()
    }

    /// The shares of the packet that was taken last.
    pub fn shares(&self) -> &Sharer {
        &self.sharer
    }

    /// Counts bytes that are given to the link at `now` besides: shares that are sent again, telemetry.
    ///
    /// # Errors
    /// If the time is not finite.
    pub fn count(&mut self, now: f64, bytes: usize) -> Result<(), ModemError> {
        check_time(now)?;
        self.control.sent(now, bytes);
        Ok(())
    }

    /// The link carries another bit rate from `now` on: see [`RateControl::set_bit_rate`].
    ///
    /// # Errors
    /// If the rate is not positive and finite, or the time not finite. The rate before stays.
    pub fn set_bit_rate(&mut self, now: f64, bit_rate: f64) -> Result<(), ModemError> {
        check_time(now)?;
        self.control.set_bit_rate(now, bit_rate)
    }

    /// The link's loss, as it was measured: packets from here on are protected against it.
    ///
    /// # Errors
    /// If it is outside its range. The one before stays.
    pub fn set_loss(&mut self, loss: Loss) -> Result<(), ModemError> {
        self.control.set_loss(loss)
    }

    /// The rate control, with rate and loss as they are now.
    pub fn control(&self) -> &RateControl {
        &self.control
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
    use crate::modem::tests::{Recipe, packet_of};
    use crate::modem::{Collected, Collector, CollectorOptions};
    use crate::packet::PoseProfile;
    use crate::random::Random;

    fn options() -> SenderOptions {
        let control = RateControlOptions {
            bit_rate: 20_000.0,
            mtu: 64,
            overhead: 0,
            latency: 1.5,
            delay: 0.2,
            spread: 0.5,
            frame_rate: 15.0,
            least: 40,
            most_shares: 16,
            loss: Loss { chance: 0.2, burst: 1.0 },
            user: None,
        };
        SenderOptions { control, stream: 1, answers: false }
    }

    /// A packet of at most so many bytes.
    fn packet(frame: u32, bytes: usize) -> Vec<u8> {
        let (profile, payload) = (PoseProfile::Short, Some(bytes - 22));
        packet_of(Recipe { frame, profile, camera: false, payload })
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
                let sharing = sender.push(now, &packet, None).unwrap();
                assert!(sharing.capacity() >= packet.len());
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

    /// Sends so many frames over a link that loses shares by chance. The topside reports every second, and the report comes
    /// `delay` later. Pictures that came in time, and the sender.
    fn run(frames: u32, chance: f32, delay: Option<f64>) -> (usize, Sender) {
        let control = RateControlOptions {
            latency: 2.5,
            delay: 0.1,
            loss: Loss { chance: 0.05, burst: 1.0 },
            ..options().control
        };
        let answers = delay.is_some();
        let mut sender = Sender::new(SenderOptions { control, stream: 1, answers }).unwrap();
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
                sender.hear(now, &report).unwrap();
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
        let believed = sender.control().options().loss.chance;
        assert!((0.3..0.5).contains(&believed), "{believed}");
        // No loss, nothing to send again.
        let (all, sender) = run(150, 0.0, Some(0.2));
        // The shares of the last half second wait still.
        let statistics = sender.statistics();
        assert!(all as u64 + 8 >= statistics.packets, "{all} {statistics:?}");
        assert_eq!(statistics.resent, 0);
        assert!(sender.control().options().loss.chance < 0.02);
    }

    #[test]
    fn reports_of_others_are_refused() {
        let report = |stream| Report::new(stream, 5, std::iter::empty()).unwrap();
        let mut deaf = Sender::new(options()).unwrap();
        assert_eq!(deaf.hear(0.0, &report(1)), Err(ModemError::NoAnswers));
        let mut sender = Sender::new(SenderOptions { answers: true, ..options() }).unwrap();
        assert_eq!(sender.hear(0.0, &report(1)), Ok(Heard::default()));
        let other = ModemError::ReportStream { found: 2, expected: 1 };
        assert_eq!(sender.hear(0.0, &report(2)), Err(other));
        assert_eq!(sender.hear(f64::NAN, &report(1)).map_err(|_| ()), Err(()));
    }

    #[test]
    fn a_packet_with_the_camera_takes_more_for_once() {
        let tight =
            RateControlOptions { bit_rate: 12_000.0, frame_rate: 30.0, ..options().control };
        let mut sender =
            Sender::new(SenderOptions { control: tight, stream: 0, answers: false }).unwrap();
        sender.plan(0.0).unwrap().unwrap();
        let (profile, payload) = (PoseProfile::Compact, Some(300));
        let long = packet_of(Recipe { frame: 0, profile, camera: true, payload });
        let sharing = sender.push(0.0, &long, None).unwrap();
        assert!((49..long.len()).contains(&sharing.capacity()), "{sharing:?}");
        assert_eq!(sender.statistics().cut, 1);
        let after = (1..30).find(|frame| sender.plan(f64::from(*frame) / 30.0).unwrap().is_some());
        assert!(after > Some(1), "the next frames pay for it");
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
        let control = RateControlOptions { most_shares: 257, ..options().control };
        assert!(Sender::new(SenderOptions { control, stream: 0, answers: true }).is_err());
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
                        Sender::new(SenderOptions { control, stream: 0, answers: true })
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
