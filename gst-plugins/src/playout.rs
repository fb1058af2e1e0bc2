//! When a packet's shares have come, which packet goes on, and when it is shown.
//!
//! A frame's time is that of its number: numbers count the camera's frames. When frame 0 was taken follows from the
//! shares: a share never comes before its frame was taken plus what the link takes at least. So pictures are shown
//! evenly, however unevenly shares come. A packet waits until it is complete, at most for the latency. Then it goes on
//! with what has come of it.

use std::collections::BTreeMap;

use nvsprior::keys::Keys;
use nvsprior::modem::{Collected, Collector, CollectorOptions, CollectorStatistics, ModemError};

/// How packets are put together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlayoutOptions {
    /// The largest share, bytes.
    pub mtu: usize,
    pub shares: usize,
    pub stream: u8,
    /// Seconds from a frame's time to when it goes on at the latest.
    pub latency: f64,
    /// The camera's frames per second, if they are known.
    pub frame_rate: Option<f64>,
}

/// A packet that goes on.
#[derive(Debug, PartialEq)]
pub struct Played {
    /// Frame number, counted on beyond 2¹⁶.
    pub frame: i64,
    /// The frame's time, seconds.
    pub time: f64,
    /// All of the packet, or its start.
    pub bytes: Vec<u8>,
    pub complete: bool,
    /// It does not follow the one before: the vehicle counts anew, or its clock does.
    pub restarted: bool,
}

/// A packet of which something has come.
#[derive(Clone, Copy, Debug)]
struct Waiting {
    time: f64,
    complete: bool,
}

/// Packets held, those of which shares may come.
const PACKETS: usize = 64;
/// Packets state their frame number modulo this.
const FRAMES: i64 = 1 << 16;
/// Shares tell packets apart by their frame number modulo this.
const NUMBERS: u32 = 256;
/// Camera frames after which a packet is stale at the latest: no more packets are held.
const STALE: f64 = 60.0;
/// Seconds for which packets are kept beyond the latency, so that the loss is known.
const KEPT: f64 = 2.0;
/// How fast the time of frame 0 follows clocks that run apart: this part of what shares come late.
const FOLLOW: f64 = 1.0 / 512.0;
/// Seconds beyond the latency by which a frame's time may differ from the times before. More means other clocks.
const APART: f64 = 1.0;

pub struct Playout {
    options: PlayoutOptions,
    collector: Collector,
    waiting: BTreeMap<i64, Waiting>,
    /// Greatest frame number of a packet that yields a picture.
    newest: Option<i64>,
    /// The last frame that went on, and its time.
    last: Option<(i64, f64)>,
    /// The time of frame 0, seconds.
    origin: Option<f64>,
    restarted: bool,
    /// When the first shares came, seconds, by number modulo 256: before a frame number is known.
    heard: BTreeMap<u32, f64>,
    /// Packets that came too late, and the last of them.
    late: u64,
    latest: Option<i64>,
}

impl Playout {
    /// `keys`: those of the vehicle.
    pub fn new(options: PlayoutOptions, keys: Option<&Keys>) -> Result<Playout, ModemError> {
        let stale = options.frame_rate.map_or(f64::INFINITY, |rate| STALE / rate);
        let collect = CollectorOptions {
            shares: options.shares,
            packets: PACKETS,
            streams: usize::from(options.stream) + 1,
            age: (options.latency + KEPT).min(stale),
            ..CollectorOptions::new(options.mtu)
        };
        let collector = match keys {
            Some(keys) => Collector::with_keys(collect, keys)?,
            None => Collector::new(collect)?,
        };
        Ok(Playout {
            options,
            collector,
            waiting: BTreeMap::new(),
            newest: None,
            last: None,
            origin: None,
            restarted: true,
            heard: BTreeMap::new(),
            late: 0,
            latest: None,
        })
    }

    /// Sets how long packets wait from here on.
    pub fn set_latency(&mut self, latency: f64) {
        self.options.latency = latency;
    }

    pub fn statistics(&self) -> CollectorStatistics {
        self.collector.statistics()
    }

    /// What the vehicle is to know of packets that came, as a modem frame. `None`: none has come yet.
    pub fn report(&mut self) -> Result<Option<Vec<u8>>, ModemError> {
        // Which frames were decoded in full is not known here.
        let report = self.collector.report(self.options.stream, |_| false)?;
        let Some(report) = report else { return Ok(None) };
        let mut bytes = vec![0; self.options.mtu];
        let len = self.collector.write_report(&report, None, &mut bytes)?;
        bytes.truncate(len);
        Ok(Some(bytes))
    }

    /// With keys: the number of the next report.
    pub fn next_number(&self) -> Option<u64> {
        self.collector.next_number()
    }

    /// Packets that came only after a later one had gone on, or after their time.
    pub fn late(&self) -> u64 {
        self.late
    }

    /// Takes a share that came at `now`, seconds on a clock that does not go back.
    pub fn push(&mut self, now: f64, share: &[u8]) -> Result<(), ModemError> {
        let collected = self.collector.push(now, share)?;
        let frame = match collected {
            Collected::Complete(stream, frame) | Collected::Grown(stream, frame) => {
                if stream != self.options.stream {
                    return Ok(());
                }
                Some(i64::from(frame))
            }
            Collected::Kept => None,
            Collected::Duplicate | Collected::Surplus | Collected::Damaged(..) => return Ok(()),
        };
        if let Some(stated) = frame {
            let frame = self.count_on(stated);
            self.see(now, frame);
            if let (Collected::Complete(..), Some(waiting)) =
                (collected, self.waiting.get_mut(&frame))
            {
                waiting.complete = true;
            }
        }
        self.see_others(now);
        Ok(())
    }

    /// A frame number as it is counted here.
    fn count_on(&mut self, stated: i64) -> i64 {
        let Some(newest) = self.newest else {
            self.newest = Some(stated);
            return stated;
        };
        let ahead = (stated - newest).rem_euclid(FRAMES);
        let ahead = if ahead > FRAMES / 2 { ahead - FRAMES } else { ahead };
        let frame = newest + ahead;
        if ahead <= -(PACKETS as i64) {
            // It was given up long ago, so this is another count.
            self.restart();
            self.newest = Some(frame);
        }
        self.newest = self.newest.max(Some(frame));
        frame
    }

    /// Forgets the frames so far, and when they were taken.
    fn restart(&mut self) {
        self.waiting.clear();
        (self.last, self.origin, self.restarted) = (None, None, true);
    }

    /// Notes the packets of which only such shares came that yield no picture yet.
    fn see_others(&mut self, now: f64) {
        let Some(newest) = self.newest else {
            for number in 0..NUMBERS {
                if self.collector.arrived(self.options.stream, number).next().is_some() {
                    self.heard.entry(number).or_insert(now);
                }
            }
            return;
        };
        let half = PACKETS as i64;
        for frame in newest - half + 1..=newest + half {
            let gone = self.last.is_some_and(|(last, _)| frame <= last);
            if gone || self.waiting.contains_key(&frame) {
                continue;
            }
            let number = frame.rem_euclid(FRAMES) as u32;
            if self.collector.arrived(self.options.stream, number).next().is_some() {
                self.see(now, frame);
            }
        }
        self.heard.clear();
    }

    /// Notes a packet of which a share came at `now`.
    fn see(&mut self, now: f64, frame: i64) {
        if self.waiting.contains_key(&frame) {
            return;
        }
        if self.last.is_some_and(|(last, _)| frame <= last) {
            self.late += u64::from(self.latest.replace(frame) != Some(frame));
            return;
        }
        let number = frame.rem_euclid(i64::from(NUMBERS)) as u32;
        let now = self.heard.remove(&number).unwrap_or(now);
        let time = match self.options.frame_rate {
            None => now,
            Some(rate) => self.learn(now, frame as f64 / rate) + frame as f64 / rate,
        };
        self.waiting.insert(frame, Waiting { time, complete: false });
    }

    /// The time of frame 0, now that a share has come of a frame that was taken `after` seconds later.
    fn learn(&mut self, now: f64, after: f64) -> f64 {
        let seen = now - after;
        let origin = match self.origin {
            None => seen,
            Some(origin) => {
                let late = seen - origin;
                if late > self.options.latency + APART || late < -APART {
                    self.restarted = true;
                    seen
                } else if late < 0.0 {
                    seen
                } else {
                    origin + FOLLOW * late
                }
            }
        };
        self.origin = Some(origin);
        origin
    }

    /// When the next packet goes on at the latest, seconds.
    pub fn deadline(&self) -> Option<f64> {
        let (_, first) = self.waiting.first_key_value()?;
        Some(first.time + self.options.latency)
    }

    /// The next packet that goes on at `now`, in the order of frames.
    pub fn next(&mut self, now: f64) -> Option<Played> {
        loop {
            let (&frame, &first) = self.waiting.first_key_value()?;
            if !first.complete && first.time + self.options.latency > now {
                return None;
            }
            self.waiting.remove(&frame);
            // Times must not fall.
            let time = self.last.map_or(first.time, |(_, last)| first.time.max(last));
            self.last = Some((frame, time));
            let number = frame.rem_euclid(FRAMES) as u32;
            // Without a picture nothing goes on: what was shown before stays.
            if let Some(packet) = self.collector.packet(self.options.stream, number) {
                let (bytes, complete) = (packet.bytes.to_vec(), packet.complete);
                let restarted = std::mem::take(&mut self.restarted);
                return Some(Played { frame, time, bytes, complete, restarted });
            }
        }
    }
}

#[cfg(test)]
mod tests;
