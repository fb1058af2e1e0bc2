//! From which age on a picture is old. The vehicle tells it in two bits, as it alone knows rate, delay and frame rate.

use crate::modem::RateControlOptions;

/// So many times the limit, and what is shown is very old: after 30 s at most.
pub const VERY_OLD: f64 = 2.5;
/// What is told, seconds.
const LIMITS: [f64; 4] = [3.0, 5.0, 8.0, 12.0];

/// One of the limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AgeLimit(u8);

impl AgeLimit {
    /// Where none is told.
    pub const UNTOLD: AgeLimit = AgeLimit(1);

    /// Twice the greatest age of a picture with all well: its latency, the time until the next packet begins, and what
    /// a report takes, as ages are told too large by that. Twice: a packet may be lost, and the encoder be slow. It is
    /// rounded up.
    pub fn of(link: &RateControlOptions) -> AgeLimit {
        let carried = |bytes: usize| bytes as f64 * 8.0 / link.bit_rate;
        let between = carried(link.min_bytes).max(1.0 / link.frame_rate);
        let report = link.delay + carried(link.mtu + link.overhead);
        let limit = 2.0 * (link.latency + between + report);
        let enough = LIMITS.iter().position(|told| *told >= limit);
        AgeLimit(enough.unwrap_or(LIMITS.len() - 1) as u8)
    }

    /// By its two bits.
    pub fn from_bits(bits: u16) -> AgeLimit {
        AgeLimit(bits as u8 % LIMITS.len() as u8)
    }

    /// Its two bits.
    pub fn bits(self) -> u16 {
        self.0.into()
    }

    /// The age, seconds.
    pub fn seconds(self) -> f64 {
        LIMITS[usize::from(self.0)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::modem::Loss;

    #[test]
    fn the_limit_follows_the_link_and_is_bounded() {
        let of = |bit_rate, latency, delay, frame_rate| {
            let (mtu, overhead, spread, min_bytes, max_shares) = (64, 0, 0.0, 100, 16);
            #[rustfmt::skip]
            let link = RateControlOptions {
                bit_rate, mtu, overhead, latency, delay, spread, frame_rate, min_bytes, max_shares,
                loss: Loss::NONE, user: None,
            };
            AgeLimit::of(&link).seconds()
        };
        // 2 · (2 + 0.4 + 1 + 0.256) = 7.312. At such a link ages of 4.1 to 5.5 s were seen.
        assert_eq!(of(2e3, 2.0, 1.0, 3.0), 8.0);
        // 2 · (1 + 0.5 + 0.2 + 0.0512) = 3.5.
        assert_eq!(of(1e4, 1.0, 0.2, 2.0), 5.0);
        assert_eq!((of(1e6, 0.3, 0.1, 15.0), of(100.0, 9.0, 3.0, 0.1)), (3.0, 12.0));
        for bits in 0..4 {
            assert_eq!(AgeLimit::from_bits(bits).bits(), bits);
            assert!(AgeLimit::from_bits(bits).seconds() * VERY_OLD <= 30.0);
        }
    }
}
