//! The simulated channel: one modem frame after another, some of them lost.

use nvsprior::modem::Loss;
use nvsprior::random::Random;

use super::Setting;

pub struct Sent {
    /// When the modem has sent it, seconds.
    #[cfg(test)]
    end: f64,
    /// When it arrives; `None`: it is lost.
    pub arrival: Option<f64>,
}

/// Carries modem frames, and loses them as Gilbert's model says.
pub struct Channel {
    bit_rate: f64,
    overhead: usize,
    propagation: f64,
    loss: Loss,
    reorder: f64,
    /// Nothing arrives from the first time to the second.
    blackout: [f64; 2],
    random: Random,
    lost_before: bool,
    free: f64,
    /// What was sent: the end, and bytes with their overhead.
    pub log: Vec<(f64, usize)>,
}

impl Channel {
    pub fn new(setting: &Setting, seconds: f64) -> Channel {
        let middle = seconds / 2.0;
        Channel {
            bit_rate: setting.bit_rate,
            overhead: setting.overhead,
            propagation: setting.propagation,
            loss: setting.loss,
            reorder: setting.reorder,
            blackout: [middle, middle + setting.blackout],
            random: Random::new(setting.seed),
            lost_before: false,
            free: 0.0,
            log: Vec::new(),
        }
    }

    fn chance(&mut self) -> f64 {
        f64::from(self.random.within(0.0, 1.0))
    }

    /// Sends a modem frame of a length that is ready at `now`, after those before it.
    pub fn send(&mut self, now: f64, len: usize) -> Sent {
        let bytes = len + self.overhead;
        let duration = bytes as f64 * 8.0 / self.bit_rate;
        let end = self.free.max(now) + duration;
        self.free = end;
        self.log.push((end, bytes));
        // All are drawn for each frame, so that runs of one seed are alike.
        let (loses, late) = (self.chance(), self.chance());
        self.lost_before = loses < self.loss.steps()[usize::from(self.lost_before)];
        let dark = (self.blackout[0]..self.blackout[1]).contains(&end);
        let late = if late < self.reorder { 2.5 * duration } else { 0.0 };
        let arrival = (!self.lost_before && !dark).then_some(end + self.propagation + late);
        Sent {
            #[cfg(test)]
            end,
            arrival,
        }
    }

    /// The other side has the channel for so many bytes, on their way there and back.
    pub fn occupy(&mut self, now: f64, len: usize) {
        let duration = (len + self.overhead) as f64 * 8.0 / self.bit_rate + 2.0 * self.propagation;
        self.free = self.free.max(now) + duration;
    }

    /// Most bits in any second.
    pub fn worst_second(&self) -> f64 {
        let on_air = |start: f64| -> f64 {
            let seconds = |(end, bytes): &(f64, usize)| {
                let begin = end - *bytes as f64 * 8.0 / self.bit_rate;
                (end.min(start + 1.0) - begin.max(start)).max(0.0)
            };
            let from = self.log.partition_point(|(end, _)| *end < start);
            let near = self.log[from..]
                .iter()
                .take_while(|(end, bytes)| end - *bytes as f64 * 8.0 / self.bit_rate < start + 1.0);
            near.map(seconds).sum::<f64>() * self.bit_rate
        };
        let starts = self.log.iter().map(|(end, bytes)| end - *bytes as f64 * 8.0 / self.bit_rate);
        starts.map(on_air).fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::tests::setting;

    #[test]
    fn frames_follow_each_other_at_the_bit_rate() {
        let mut channel = Channel::new(&setting(), 10.0);
        let sent: Vec<_> = (0..10).map(|_| channel.send(1.0, 50)).collect();
        for (k, sent) in sent.iter().enumerate() {
            assert!((sent.end - (1.0 + 0.1 * (k + 1) as f64)).abs() < 1e-9);
            assert!((sent.arrival.unwrap() - sent.end - 0.25).abs() < 1e-9);
        }
        assert!((channel.worst_second() - 4000.0).abs() < 1e-6);
    }

    #[test]
    fn as_many_are_lost_as_said() {
        let loss = Loss { chance: 0.2, burst: 4.0 };
        let mut channel = Channel::new(&super::super::Setting { loss, ..setting() }, 1.0);
        let lost = (0..40_000).filter(|_| channel.send(0.0, 10).arrival.is_none()).count();
        assert!((7_400..8_600).contains(&lost), "{lost}");
    }

    #[test]
    fn nothing_arrives_in_a_blackout_and_late_frames_come_behind_others() {
        let dark = super::super::Setting { blackout: 2.0, reorder: 0.5, ..setting() };
        let mut channel = Channel::new(&dark, 10.0);
        let mut arrivals = Vec::new();
        for k in 0..80 {
            let sent = channel.send(0.1 * f64::from(k), 20);
            assert_eq!(sent.arrival.is_none(), (5.0..7.0).contains(&sent.end), "{}", sent.end);
            arrivals.extend(channel.send(0.0, 20).arrival);
        }
        assert!(arrivals.windows(2).any(|pair| pair[1] < pair[0]));
    }
}
