//! Which frame is shown next, and when.
//!
//! A frame's time is that of its number: numbers count the camera's frames. When frame 0 was taken follows from the
//! shares: a share never comes before its frame was taken plus what the link takes at least. So pictures are shown
//! evenly, however unevenly shares come. A packet waits until it is complete, at most for the latency. Then it goes on
//! with what has come of it.

use crate::modem::Collector;

/// A frame that goes on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Due {
    /// Frame number, counted on beyond 2¹⁶.
    pub frame: i64,
    /// The frame's time, seconds.
    pub time: f64,
    /// It does not follow the one before: the vehicle counts anew, or its clock does.
    pub restarted: bool,
}

/// A packet of which something has come.
#[derive(Clone, Copy, Debug)]
struct Waiting {
    frame: i64,
    time: f64,
    complete: bool,
}

/// Packets held, those of which shares may come.
const PACKETS: usize = 64;
/// Packets state their frame number modulo this.
const FRAMES: i64 = 1 << 16;
/// Shares tell packets apart by their frame number modulo this.
const NUMBERS: usize = 256;
/// How fast the time of frame 0 follows clocks that run apart: this part of what shares come late.
const FOLLOW: f64 = 1.0 / 512.0;
/// Seconds beyond the latency by which a frame's time may differ from the times before. More means other clocks.
const APART: f64 = 1.0;
/// Frames in a row that all come late, after which the time of frame 0 is that by which the first of them came in time.
const WINDOW: u32 = 16;
/// Packets in a row that come too late, after which the vehicle counts anew.
const LATE: u32 = 8;

/// The order of frames and their times, in memory that is taken once.
#[derive(Debug)]
pub(super) struct Schedule {
    /// Seconds from a frame's time to when it goes on at the latest.
    latency: f64,
    /// The camera's frames per second, if they are known.
    frame_rate: Option<f64>,
    /// In the order of frames.
    waiting: Vec<Waiting>,
    /// Greatest frame number of a packet that yields a picture.
    newest: Option<i64>,
    /// The last frame that went on, and its time.
    last: Option<(i64, f64)>,
    /// The time of frame 0, seconds.
    origin: Option<f64>,
    restarted: bool,
    /// When the first shares came, seconds, by number modulo 256: before a frame number is known.
    heard: Vec<Option<f64>>,
    /// Packets that came too late, and the last of them.
    late: u64,
    latest: Option<i64>,
    /// Of them, in a row.
    late_run: u32,
    /// How late the frames of a window came at least, seconds, and how many they are.
    least_late: f64,
    window: u32,
}

impl Schedule {
    pub fn new(latency: f64, frame_rate: Option<f64>) -> Schedule {
        Schedule {
            latency,
            frame_rate,
            waiting: Vec::with_capacity(2 * PACKETS + 1),
            newest: None,
            last: None,
            origin: None,
            restarted: true,
            heard: vec![None; NUMBERS],
            late: 0,
            latest: None,
            late_run: 0,
            least_late: f64::INFINITY,
            window: 0,
        }
    }

    /// Sets how long packets wait from here on.
    pub fn set_latency(&mut self, latency: f64) {
        self.latency = latency;
    }

    /// Packets that came only after a later one had gone on, or after their time.
    pub fn late(&self) -> u64 {
        self.late
    }

    /// Notes a modem frame that came at `now`: the frame whose packet has more bytes, or is whole, if there is one.
    pub fn note(
        &mut self,
        now: f64,
        grown: Option<(u32, bool)>,
        (collector, stream): (&Collector, u8),
    ) {
        if let Some((stated, is_whole)) = grown {
            let frame = self.count_on(stated.into());
            self.see(now, frame);
            if let Ok(at) = self.find(frame) {
                self.waiting[at].complete |= is_whole;
            }
        }
        let has_some = |number| collector.arrived(stream, number).next().is_some();
        self.see_others(now, has_some);
    }

    fn find(&self, frame: i64) -> Result<usize, usize> {
        self.waiting.binary_search_by_key(&frame, |waiting| waiting.frame)
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
        self.late_run = 0;
    }

    /// Notes the packets of which only such shares came that yield no picture yet.
    fn see_others(&mut self, now: f64, has_some: impl Fn(u32) -> bool) {
        let Some(newest) = self.newest else {
            for (number, heard) in (0..).zip(&mut self.heard) {
                if has_some(number) {
                    heard.get_or_insert(now);
                }
            }
            return;
        };
        let half = PACKETS as i64;
        for frame in newest - half + 1..=newest + half {
            let gone = self.last.is_some_and(|(last, _)| frame <= last);
            if !gone && self.find(frame).is_err() && has_some(number_of(frame)) {
                self.see(now, frame);
            }
        }
        self.heard.fill(None);
    }

    /// Notes a packet of which a share came at `now`.
    fn see(&mut self, now: f64, frame: i64) {
        let Err(at) = self.find(frame) else { return };
        if self.last.is_some_and(|(last, _)| frame <= last) {
            if self.latest.replace(frame) != Some(frame) {
                self.late += 1;
                self.late_run += 1;
            }
            if self.late_run < LATE {
                return;
            }
            self.restart();
            self.newest = Some(frame);
            return self.see(now, frame);
        }
        self.late_run = 0;
        let heard = self.heard[frame.rem_euclid(NUMBERS as i64) as usize].take();
        let now = heard.unwrap_or(now);
        let time = match self.frame_rate {
            None => now,
            Some(rate) => self.learn(now, frame as f64 / rate) + frame as f64 / rate,
        };
        self.waiting.insert(at, Waiting { frame, time, complete: false });
        if self.waiting.len() > 2 * PACKETS {
            self.waiting.remove(0);
        }
    }

    /// The time of frame 0, now that a share has come of a frame that was taken `after` seconds later.
    fn learn(&mut self, now: f64, after: f64) -> f64 {
        let seen = now - after;
        let origin = match self.origin {
            None => seen,
            Some(origin) => {
                let late = seen - origin;
                self.least_late = self.least_late.min(late);
                self.window += 1;
                let is_full = self.window == WINDOW;
                if late > self.latency + APART || late < -APART {
                    self.restarted = true;
                    seen
                } else if late < 0.0 {
                    seen
                } else if is_full {
                    origin + self.least_late.max(FOLLOW * late)
                } else {
                    origin + FOLLOW * late
                }
            }
        };
        if self.window == WINDOW {
            (self.least_late, self.window) = (f64::INFINITY, 0);
        }
        self.origin = Some(origin);
        origin
    }

    /// When the next frame goes on at the latest, seconds.
    pub fn deadline(&self) -> Option<f64> {
        Some(self.waiting.first()?.time + self.latency)
    }

    /// The next frame that goes on at `now`, in order, if something of its packet came that makes a picture. Without
    /// that nothing goes on: what was shown before stays.
    pub fn next(&mut self, now: f64, has_picture: impl Fn(u32) -> bool) -> Option<Due> {
        loop {
            let Waiting { frame, time, complete } = *self.waiting.first()?;
            if !complete && time + self.latency > now {
                return None;
            }
            self.waiting.remove(0);
            // Times must not fall.
            let time = self.last.map_or(time, |(_, last)| time.max(last));
            self.last = Some((frame, time));
            if has_picture(number_of(frame)) {
                let restarted = std::mem::take(&mut self.restarted);
                return Some(Due { frame, time, restarted });
            }
        }
    }
}

/// A frame number as packets state it.
pub fn number_of(frame: i64) -> u32 {
    frame.rem_euclid(FRAMES) as u32
}

#[cfg(test)]
mod tests;
