//! What the vehicle makes of what comes back.

use super::event::VehicleEvent;

/// Things that are no report, while no report comes, after which something must be wrong.
const STRANGERS: u64 = 20;
/// Seconds after which a topside that was heard is away.
const AWAY: f64 = 30.0;

/// Knows whether the topside is heard.
#[derive(Debug, Default)]
pub(super) struct Hearing {
    last: Option<f64>,
    is_away: bool,
    /// What came that was no report, since none comes.
    strangers: u64,
}

impl Hearing {
    /// A report came. What changed is told, here and below.
    pub fn report(&mut self, now: f64) -> Option<VehicleEvent> {
        let is_new = self.last.is_none() || self.is_away;
        *self = Hearing { last: Some(now), is_away: false, strangers: 0 };
        is_new.then_some(VehicleEvent::TopsideHeard)
    }

    /// Something came that is no report. While reports come it tells nothing.
    pub fn stranger(&mut self) -> Option<VehicleEvent> {
        if self.last.is_some() && !self.is_away {
            return None;
        }
        self.strangers += 1;
        (self.strangers == STRANGERS).then_some(VehicleEvent::Strangers(STRANGERS))
    }

    pub fn silence(&mut self, now: f64) -> Option<VehicleEvent> {
        let silence = now - self.last?;
        if self.is_away || silence < AWAY {
            return None;
        }
        self.is_away = true;
        Some(VehicleEvent::TopsideSilent(silence))
    }
}

/// Lets a topside that does not know what packets are about have a full one: at most one in the time that sending it
/// twice takes. Without keys anybody may ask.
#[derive(Debug, Default)]
pub(super) struct FullPackets {
    is_due: bool,
    /// Seconds; `None`: none was sent before.
    until: Option<f64>,
}

impl FullPackets {
    /// Whether one is to be sent.
    pub fn ask(&mut self, now: f64) -> bool {
        let is_taken = !self.is_due && self.until.is_none_or(|until| now >= until);
        self.is_due |= is_taken;
        is_taken
    }

    /// A packet was sent, which takes a time on the link, seconds.
    pub fn sent(&mut self, now: f64, seconds: f64) {
        if std::mem::take(&mut self.is_due) {
            self.until = Some(now + 2.0 * seconds);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_changes_is_told_once() {
        let mut hearing = Hearing::default();
        assert_eq!(hearing.silence(100.0), None, "it was never there");
        let told: Vec<_> = (0..50).filter_map(|_| hearing.stranger()).collect();
        assert_eq!(told, [VehicleEvent::Strangers(20)]);
        assert_eq!(hearing.report(1.0), Some(VehicleEvent::TopsideHeard));
        assert_eq!((hearing.report(2.0), hearing.silence(31.0)), (None, None));
        assert!((0..50).all(|_| hearing.stranger().is_none()), "reports come among them");
        let silent = Some(VehicleEvent::TopsideSilent(31.0));
        assert_eq!((hearing.silence(33.0), hearing.silence(34.0)), (silent, None));
        assert_eq!(hearing.report(35.0), Some(VehicleEvent::TopsideHeard));
    }

    #[test]
    fn who_asks_for_full_packets_again_and_again_gets_one_in_a_while() {
        let (mut full, mut sent) = (FullPackets::default(), 0);
        for tenth in 0..100 {
            let now = 0.1 * f64::from(tenth);
            sent += usize::from(full.ask(now));
            full.sent(now, 1.0);
        }
        assert_eq!(sent, 5);
    }
}
