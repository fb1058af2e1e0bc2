//! How often, and how much, a modem pulls: a stack that shares its link with other traffic asks when it has room.

use std::collections::VecDeque;

/// Pulls that are looked at.
const PULLS: usize = 64;
/// And seconds of them.
const WINDOW: f64 = 20.0;
/// Modem frames that may wait still when another packet is ready: it goes first, and they follow.
const SLACK: f64 = 0.5;
/// A packet that nobody pulled is made anew, if the last pull is not longer ago than so many latencies.
const PATIENCE: f64 = 4.0;

/// What was pulled of late.
#[derive(Debug)]
pub(super) struct PullRate {
    /// When, seconds, and how many bytes there was room for.
    pulls: VecDeque<(f64, usize)>,
    /// Fewest seconds from one packet to the next.
    between: f64,
    latency: f64,
    min_bytes: usize,
    /// Longest time of late from a frame's exposure to its packet, seconds.
    coding: f64,
    /// When the frame was exposed whose packet waits; `None`: none waits, or some of it was pulled.
    untouched: Option<f64>,
    /// Part of a modem frame that packets had too few so far.
    owed: f64,
}

impl PullRate {
    pub fn new(frame_rate: f64, latency: f64, min_bytes: usize) -> PullRate {
        let (pulls, between) = (VecDeque::with_capacity(PULLS + 1), 1.0 / frame_rate);
        PullRate { pulls, between, latency, min_bytes, coding: 0.0, untouched: None, owed: 0.0 }
    }

    /// The modem has room for so many bytes.
    pub fn pulled(&mut self, now: f64, most: usize) {
        self.pulls.push_back((now, most));
        if self.pulls.len() > PULLS {
            self.pulls.pop_front();
        }
        while self.pulls.front().is_some_and(|(time, _)| time + WINDOW < now) {
            self.pulls.pop_front();
        }
    }

    /// Something of the packet that waits goes out.
    pub fn touched(&mut self) {
        self.untouched = None;
    }

    /// A packet is ready whose frame was exposed at a time.
    pub fn ready(&mut self, now: f64, exposed: f64) {
        self.coding = (now - exposed).max(0.9 * self.coding);
        self.untouched = Some(exposed);
    }

    /// Pulls per second; `None`: nothing was pulled twice yet.
    fn pulls(&self, now: f64) -> Option<f64> {
        let (first, last) = (self.pulls.front()?.0, self.pulls.back()?.0);
        let steps = self.pulls.len().checked_sub(1).filter(|steps| *steps > 0)? as f64;
        // If the next one is overdue, they have become fewer.
        let overdue = (now - last - (last - first) / steps).max(0.0);
        let seconds = last - first + overdue;
        (seconds > 0.0).then_some(steps / seconds)
    }

    /// Fewest bytes that there was room for; `None`: nothing was pulled.
    pub fn least(&self) -> Option<usize> {
        self.pulls.iter().map(|(_, most)| *most).min()
    }

    /// Bytes per second that are pulled; `None`: nothing was pulled twice yet.
    pub fn rate(&self, now: f64) -> Option<f64> {
        Some(self.pulls(now)? * self.least()? as f64)
    }

    /// Modem frames for the packet of a frame that is exposed now, of at most [`least`](Self::least) bytes each, or of
    /// `mtu` if that is not known. `waiting`: bytes of the packet before that nobody has pulled. `None`: they will not
    /// have gone by the time it is coded.
    pub fn frames(&mut self, now: f64, waiting: usize, mtu: usize) -> Option<usize> {
        let pulls = self.pulls(now);
        let most = self.least().unwrap_or(mtu).max(1);
        if let Some(exposed) = self.untouched {
            // Nobody has taken any of it. If it is old, and pulls go on, a newer one takes its place.
            let last = self.pulls.back().map_or(f64::NEG_INFINITY, |(time, _)| *time);
            let is_stale = now - exposed > self.latency;
            if !is_stale || now - last > PATIENCE * self.latency {
                return None;
            }
        } else if waiting as f64 > (pulls.unwrap_or(0.0) * self.coding + SLACK) * most as f64 {
            return None;
        }
        let turn = pulls.map_or(1.0, |pulls| pulls * self.coding.max(self.between)) + self.owed;
        // Rounding of times must not cost one.
        let frames = (turn + 1e-6).floor().max(self.min_bytes.div_ceil(most) as f64).max(1.0);
        self.owed = (turn - frames).clamp(-1.0, 1.0);
        Some(frames as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_packet_has_as_many_frames_as_are_pulled() {
        let mut pull = PullRate::new(2.0, 1.0, 40);
        assert_eq!(pull.frames(0.0, 0, 64), Some(1), "nothing is known yet");
        pull.ready(0.4, 0.0);
        assert_eq!(pull.frames(0.5, 40, 64), None, "nobody has pulled it");
        for k in 0..20 {
            pull.pulled(0.5 + 0.1 * f64::from(k), 64 - k as usize % 2);
            pull.touched();
        }
        let now = 0.5 + 0.1 * 19.0;
        assert!((pull.rate(now).unwrap() - 630.0).abs() < 1.0, "{:?}", pull.rate(now));
        // Coding takes 0.4 s: what waits has gone by then if it is at most 252 bytes, and half a modem frame more. A
        // turn is half a second.
        assert_eq!((pull.frames(now, 290, 64), pull.frames(now, 280, 64)), (None, Some(5)));
        // Nobody pulls any more: a packet is made once, and again once it is stale, but not for ever.
        pull.ready(now + 0.4, now);
        let is_made = |k: &u32| pull.frames(now + 0.1 * f64::from(*k), 100, 64).is_some();
        let anew: Vec<_> = (5..200).filter(is_made).collect();
        assert!(anew.iter().all(|k| (10..=40).contains(k)) && !anew.is_empty(), "{anew:?}");
    }
}
