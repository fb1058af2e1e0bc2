//! The simulated channel, and how much it carried when.

use crate::channel::{Channel, Sent};

use super::setting::Setting;

pub struct LoggedChannel {
    channel: Channel,
    bit_rate: f64,
    /// What was sent: the end, and bytes with their overhead.
    log: Vec<(f64, usize)>,
}

impl LoggedChannel {
    pub fn new(setting: &Setting, seconds: f64) -> LoggedChannel {
        let (channel, bit_rate) = (Channel::new(setting.channel(seconds)), setting.bit_rate);
        LoggedChannel { channel, bit_rate, log: Vec::new() }
    }

    /// See [`Channel::send`].
    pub fn send(&mut self, now: f64, len: usize) -> Sent {
        let sent = self.channel.send(now, len);
        self.log.push((sent.end, sent.bytes));
        sent
    }

    /// See [`Channel::occupy`].
    pub fn occupy(&mut self, now: f64, len: usize) {
        self.channel.occupy(now, len);
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
    use crate::link::setting::tests::setting;

    #[test]
    fn a_channel_that_is_never_free_carries_its_bit_rate() {
        let mut channel = LoggedChannel::new(&setting(), 10.0);
        for _ in 0..40 {
            channel.send(1.0, 50);
        }
        assert!((channel.worst_second() - 4000.0).abs() < 1e-6);
    }
}
