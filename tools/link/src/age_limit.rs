//! From which age on a picture is old. The vehicle tells it in a byte, as it alone knows rate, delay and frame rate.

use nvsprior::modem::RateControlOptions;

/// So many times the limit, and what is shown is very old: after 30 s at most.
pub const VERY_OLD: f64 = 2.5;
/// Where no limit is told, seconds.
pub const UNTOLD: f64 = 4.0;
/// Limits, seconds.
const LEAST: f64 = 2.0;
const MOST: f64 = 12.0;
/// Steps of a second.
const STEPS: f64 = 8.0;

/// Twice the greatest age of a picture with all well: its latency, the time until the next packet begins, and what a
/// report takes, as ages are told too large by that. Twice: a packet may be lost, and the encoder be slow.
pub fn byte(link: &RateControlOptions) -> u8 {
    let carried = |bytes: usize| bytes as f64 * 8.0 / link.bit_rate;
    let between = carried(link.min_bytes).max(1.0 / link.frame_rate);
    let report = link.delay + carried(link.mtu + link.overhead);
    let limit = 2.0 * (link.latency + between + report);
    (limit.clamp(LEAST, MOST) * STEPS).ceil() as u8
}

/// Seconds that a byte tells; never more than a vehicle may tell. 0: none.
pub fn seconds(byte: u8) -> f64 {
    if byte == 0 { UNTOLD } else { (f64::from(byte) / STEPS).clamp(LEAST, MOST) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nvsprior::modem::Loss;

    #[test]
    fn the_limit_follows_the_link_and_is_bounded() {
        let of = |bit_rate, latency, delay, frame_rate| {
            let (mtu, overhead, spread, min_bytes, max_shares) = (64, 0, 0.0, 100, 16);
            #[rustfmt::skip]
            let link = RateControlOptions {
                bit_rate, mtu, overhead, latency, delay, spread, frame_rate, min_bytes, max_shares,
                loss: Loss::NONE, user: None,
            };
            seconds(byte(&link))
        };
        // 2 · (2 + 0.4 + 1 + 0.256) = 7.312, in steps of 1/8 s. At such a link ages of 4.1 to 5.5 s were seen.
        assert_eq!(of(2e3, 2.0, 1.0, 3.0), 7.375);
        // 2 · (2 + 0.5 + 0.5 + 0.0512).
        assert_eq!(of(1e4, 2.0, 0.5, 2.0), 6.125);
        assert_eq!((of(1e6, 0.3, 0.1, 15.0), of(100.0, 9.0, 3.0, 0.1)), (LEAST, MOST));
        assert_eq!([0, 1, 255].map(seconds), [UNTOLD, LEAST, MOST]);
        assert!(seconds(255) * VERY_OLD <= 30.0);
    }
}
