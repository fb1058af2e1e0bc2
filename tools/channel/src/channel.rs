//! The channel: one modem frame after another, some of them lost.

use nvsprior::modem::Loss;
use nvsprior::random::Random;

#[derive(Clone, Copy, Debug)]
pub struct ChannelOptions {
    /// Bits per second.
    pub bit_rate: f64,
    /// What a modem frame takes beside its bytes, as bytes.
    pub overhead: usize,
    /// Seconds from one end to the other.
    pub propagation: f64,
    pub loss: Loss,
    /// Chance that a modem frame arrives late, after those behind it.
    pub reorder: f64,
    /// Nothing arrives from the first time to the second.
    pub blackout: [f64; 2],
    pub seed: u64,
}

pub struct Sent {
    /// When the modem has sent it, seconds.
    pub end: f64,
    /// Its bytes with their overhead.
    pub bytes: usize,
    /// When it arrives; `None`: it is lost.
    pub arrival: Option<f64>,
}

/// Carries modem frames, and loses them as Gilbert's model says.
pub struct Channel {
    options: ChannelOptions,
    random: Random,
    lost_before: bool,
    /// When all that was given to it is sent, seconds.
    free: f64,
}

impl Channel {
    pub fn new(options: ChannelOptions) -> Channel {
        Channel { options, random: Random::new(options.seed), lost_before: false, free: 0.0 }
    }

    fn chance(&mut self) -> f64 {
        f64::from(self.random.within(0.0, 1.0))
    }

    /// Sends a modem frame of a length that is ready at `now`, after those before it.
    pub fn send(&mut self, now: f64, len: usize) -> Sent {
        let ChannelOptions { bit_rate, overhead, propagation, loss, reorder, blackout, .. } =
            self.options;
        let bytes = len + overhead;
        let duration = bytes as f64 * 8.0 / bit_rate;
        let end = self.free.max(now) + duration;
        self.free = end;
        // All are drawn for each frame, so that runs of one seed are alike.
        let (loses, late) = (self.chance(), self.chance());
        self.lost_before = loses < loss.steps()[usize::from(self.lost_before)];
        let dark = (blackout[0]..blackout[1]).contains(&end);
        let late = if late < reorder { 2.5 * duration } else { 0.0 };
        let arrival = (!self.lost_before && !dark).then_some(end + propagation + late);
        Sent { end, bytes, arrival }
    }

    /// The other side has the channel for so many bytes, on their way there and back.
    pub fn occupy(&mut self, now: f64, len: usize) {
        let ChannelOptions { bit_rate, overhead, propagation, .. } = self.options;
        let duration = (len + overhead) as f64 * 8.0 / bit_rate + 2.0 * propagation;
        self.free = self.free.max(now) + duration;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 4 kbit/s over 0.25 s, without losses.
    fn options() -> ChannelOptions {
        ChannelOptions {
            bit_rate: 4_000.0,
            overhead: 0,
            propagation: 0.25,
            loss: Loss::NONE,
            reorder: 0.0,
            blackout: [0.0; 2],
            seed: 1,
        }
    }

    #[test]
    fn frames_follow_each_other_at_the_bit_rate() {
        let mut channel = Channel::new(options());
        for k in 1..=10 {
            let sent = channel.send(1.0, 50);
            assert!((sent.end - (1.0 + 0.1 * f64::from(k))).abs() < 1e-9);
            assert!((sent.arrival.unwrap() - sent.end - 0.25).abs() < 1e-9);
        }
    }

    #[test]
    fn as_many_are_lost_as_said() {
        let loss = Loss { chance: 0.2, burst: 4.0 };
        let mut channel = Channel::new(ChannelOptions { loss, ..options() });
        let lost = (0..40_000).filter(|_| channel.send(0.0, 10).arrival.is_none()).count();
        assert!((7_400..8_600).contains(&lost), "{lost}");
    }

    #[test]
    fn nothing_arrives_in_a_blackout_and_late_frames_come_behind_others() {
        let dark = ChannelOptions { blackout: [5.0, 7.0], reorder: 0.5, ..options() };
        let mut channel = Channel::new(dark);
        let mut arrivals = Vec::new();
        for k in 0..80 {
            let sent = channel.send(0.1 * f64::from(k), 20);
            assert_eq!(sent.arrival.is_none(), (5.0..7.0).contains(&sent.end), "{}", sent.end);
            arrivals.extend(channel.send(0.0, 20).arrival);
        }
        assert!(arrivals.windows(2).any(|pair| pair[1] < pair[0]));
    }
}
