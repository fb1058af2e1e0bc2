//! What came over the link, second by second.

use std::collections::VecDeque;

use nvsprior_link::modem::CollectorStatistics;

/// Seconds that are kept.
pub const KEPT: usize = 120;
/// Seconds over which bit rate and loss are told.
const RECENT: usize = 10;
const RECENT_LOSS: usize = 30;

/// What came within a second.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Second {
    pub bytes: usize,
    /// Pictures that were shown.
    pub pictures: usize,
    /// Shares of packets gone by: those that came, and those that were sent.
    pub arrived: u64,
    pub sent: u64,
}

impl Second {
    /// Part of the shares that was lost; `None`: no packet went by.
    pub fn loss(&self) -> Option<f64> {
        part_lost(self.arrived, self.sent)
    }
}

fn part_lost(arrived: u64, sent: u64) -> Option<f64> {
    (sent > 0).then(|| sent.saturating_sub(arrived) as f64 / sent as f64)
}

#[derive(Debug, Default)]
pub struct LinkLog {
    /// The last one is this second.
    seconds: VecDeque<Second>,
    /// Which second that is, UTC.
    newest: u64,
    told: CollectorStatistics,
}

impl LinkLog {
    /// This second. Those of which nothing is known yet come before it.
    fn at(&mut self, now: f64) -> &mut Second {
        let now = now.max(0.0) as u64;
        let missing = if self.seconds.is_empty() { 1 } else { now.saturating_sub(self.newest) };
        for _ in 0..missing.min(KEPT as u64) {
            self.seconds.push_back(Second::default());
        }
        self.newest = self.newest.max(now);
        let over = self.seconds.len().saturating_sub(KEPT);
        self.seconds.drain(..over);
        let last = self.seconds.len() - 1;
        &mut self.seconds[last]
    }

    pub fn came(&mut self, now: f64, bytes: usize) {
        self.at(now).bytes += bytes;
    }

    pub fn shown(&mut self, now: f64) {
        self.at(now).pictures += 1;
    }

    /// Takes the collector's counts.
    pub fn count(&mut self, now: f64, statistics: CollectorStatistics) {
        let told = std::mem::replace(&mut self.told, statistics);
        let second = self.at(now);
        second.arrived += statistics.arrived - told.arrived;
        second.sent += statistics.sent - told.sent;
    }

    /// The last whole seconds.
    fn recent(&self, count: usize) -> impl Iterator<Item = &Second> {
        self.seconds.iter().rev().skip(1).take(count)
    }

    /// Bits per second; 0 before the first second has gone by.
    pub fn bit_rate(&self) -> f64 {
        let count = self.recent(RECENT).count().max(1);
        let bytes: usize = self.recent(RECENT).map(|second| second.bytes).sum();
        bytes as f64 * 8.0 / count as f64
    }

    /// Pictures per second.
    pub fn picture_rate(&self) -> f64 {
        let count = self.recent(RECENT).count().max(1);
        let pictures: usize = self.recent(RECENT).map(|second| second.pictures).sum();
        pictures as f64 / count as f64
    }

    /// Part of the shares that was lost of late.
    pub fn loss(&self) -> Option<f64> {
        let sums = self
            .recent(RECENT_LOSS)
            .fold((0, 0), |(arrived, sent), second| (arrived + second.arrived, sent + second.sent));
        part_lost(sums.0, sums.1)
    }

    /// The whole seconds, oldest first.
    pub fn seconds(&self) -> impl Iterator<Item = &Second> {
        self.seconds.iter().take(self.seconds.len().saturating_sub(1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_those_of_whole_seconds() {
        let mut log = LinkLog::default();
        for k in 0..40 {
            log.came(100.0 + 0.1 * f64::from(k), 50);
        }
        assert!((log.bit_rate() - 4000.0).abs() < 1e-9, "{}", log.bit_rate());
        log.came(104.0, 9999);
        assert!((log.bit_rate() - 4000.0).abs() < 1e-9, "this second does not count yet");
        log.came(114.5, 1);
        assert_eq!(log.bit_rate(), 9999.0 * 8.0 / 10.0, "nothing came for ten seconds but one");
        assert_eq!(log.seconds().count(), 14);
    }

    #[test]
    fn memory_is_bounded_and_time_may_jump() {
        let mut log = LinkLog::default();
        for now in [0.0, 1e3, 1e9, 5.0, 1e9 + 1.0, f64::MAX] {
            log.came(now, 1);
            assert!(log.seconds.len() <= KEPT);
        }
    }

    #[test]
    fn loss_is_that_of_packets_gone_by() {
        let mut log = LinkLog::default();
        assert_eq!(log.loss(), None);
        let of = |arrived, sent| CollectorStatistics { arrived, sent, ..Default::default() };
        log.count(10.0, of(90, 100));
        log.count(11.0, of(130, 150));
        log.came(12.0, 1);
        assert_eq!(log.loss(), Some(20.0 / 150.0));
        let seconds: Vec<_> = log.seconds().map(Second::loss).collect();
        assert_eq!(seconds, [Some(0.1), Some(0.2)]);
    }
}
