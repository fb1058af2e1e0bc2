//! What is missing for a picture, since when, and the first thing to try.

use nvsprior::{Error, PriorId};
use serde::Serialize;

/// Seconds without a picture after which something is missing, at least.
const QUIET: f64 = 10.0;
/// Modem frames in a row of no use, after which something must be wrong.
const STRANGERS: u64 = 20;

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Missing {
    /// Tells one cause from another.
    pub cause: &'static str,
    pub what: String,
    /// For how long.
    pub seconds: f64,
    /// The first thing to try.
    pub advice: &'static str,
}

/// Why packets that come are not shown.
#[derive(Clone, Debug, PartialEq)]
pub enum Refusal {
    /// What they are about is not known yet.
    Unknown,
    /// They are about another prior, if it is known about which.
    OtherPrior(Option<PriorId>),
    Other(String),
}

impl From<&Error> for Refusal {
    fn from(error: &Error) -> Refusal {
        match error {
            Error::SessionUnknown { .. } => Refusal::Unknown,
            Error::Estranged { .. } => Refusal::OtherPrior(None),
            Error::Packet(nvsprior::packet::PacketError::Prior { packet, .. }) => {
                Refusal::OtherPrior(Some(*packet))
            }
            other => Refusal::Other(other.to_string()),
        }
    }
}

/// The prior that the topside holds.
#[derive(Clone, Debug, Serialize)]
pub struct PriorState {
    /// The file's name.
    pub file: String,
    /// What both sides must have the same, as hexadecimal digits.
    pub identity: String,
}

/// What this side has, for the pilot.
#[derive(Clone, Debug)]
pub struct ThisSide {
    pub prior: PriorState,
    /// Which key it has; `None`: it has none.
    pub key: Option<String>,
    pub has_return_path: bool,
}

/// When what came last, UTC.
#[derive(Debug)]
pub struct Watch {
    start: f64,
    bytes: Option<f64>,
    proven: Option<f64>,
    shown: Option<f64>,
    /// Seconds without a picture that are too many on this link.
    quiet: f64,
    /// Modem frames since the last proven one, and when the first of them came.
    useless: u64,
    useless_since: f64,
}

impl Watch {
    pub fn new(now: f64) -> Watch {
        let (bytes, proven, shown) = (None, None, None);
        Watch { start: now, bytes, proven, shown, quiet: QUIET, useless: 0, useless_since: now }
    }

    /// A modem frame came; `is_proven`: checks vouch for it, `None`: that is not known yet.
    pub fn came(&mut self, time: f64, is_proven: Option<bool>) {
        self.bytes = Some(time);
        match is_proven {
            None => {}
            Some(true) => (self.proven, self.useless) = (Some(time), 0),
            Some(false) => {
                if self.useless == 0 {
                    self.useless_since = time;
                }
                self.useless += 1;
            }
        }
    }

    /// A picture is shown, which is very old at so many seconds.
    pub fn shown(&mut self, now: f64, very_old: f64) {
        (self.shown, self.quiet) = (Some(now), very_old.max(QUIET));
    }

    /// `None`: pictures come, or have not been waited for long.
    pub fn missing(&self, now: f64, refusal: Option<&Refusal>, side: &ThisSide) -> Option<Missing> {
        let is_quiet = |last: Option<f64>| now - last.unwrap_or(self.start) >= self.quiet;
        let is_strange = self.useless >= STRANGERS && now - self.useless_since >= 1.0;
        if is_strange && self.proven.is_none_or(|last| last <= self.useless_since) {
            return Some(self.unreadable(now, side));
        }
        if !is_quiet(self.shown) {
            return None;
        }
        if is_quiet(self.bytes) {
            let since = self.bytes.unwrap_or(self.start);
            let advice = "See whether the vehicle runs and sends here, and whether channel or modem carry it.";
            return Some(Missing {
                cause: "no-bytes",
                what: "Nothing comes".into(),
                seconds: now - since,
                advice,
            });
        }
        if is_quiet(self.proven) && self.useless > 0 {
            return Some(self.unreadable(now, side));
        }
        let since = self.shown.unwrap_or(self.start);
        let (cause, what, advice) = refused(refusal, side);
        Some(Missing { cause, what, seconds: now - since, advice })
    }

    fn unreadable(&self, now: f64, side: &ThisSide) -> Missing {
        let came = format!("{} modem frames came", self.useless);
        let (what, advice) = match (&side.key, self.proven) {
            (Some(key), _) => (
                format!("{came}, none with a valid tag of {key}"),
                "Give both sides the same key, --epoch and --tag. If they have them, the link damages what it carries.",
            ),
            (None, None) => (
                format!("{came}, none of them readable; this side has no key"),
                "If the vehicle has a key, give it here, too (--key). If not, look for damage, and for other senders.",
            ),
            (None, Some(_)) => (
                format!("{came}, none of them readable any more"),
                "Look for damage on the link. If the vehicle was started again, it may have a key now (--key).",
            ),
        };
        Missing { cause: "unreadable", what, seconds: now - self.useless_since, advice }
    }
}

/// Packets come, and no picture.
fn refused(refusal: Option<&Refusal>, side: &ThisSide) -> (&'static str, String, &'static str) {
    let PriorState { file, identity } = &side.prior;
    match refusal {
        Some(Refusal::OtherPrior(other)) => {
            let other = other.map_or("another prior".into(), |other| format!("prior {other}"));
            let what = format!("Packets come about {other}, not about {file} ({identity})");
            ("other-prior", what, "Start both sides with the same prior file.")
        }
        Some(Refusal::Unknown) => {
            let advice = match side.has_return_path {
                true => {
                    "The vehicle is asked. If this lasts, it does not hear this side, or holds another prior."
                }
                false => {
                    "Without a return channel nobody can ask: wait until the vehicle tells it, or start it again."
                }
            };
            ("unknown", "Packets come, but not yet what they are about".into(), advice)
        }
        Some(Refusal::Other(error)) => {
            let what = format!("A packet cannot be shown: {error}");
            ("refused", what, "See that both sides run the same version.")
        }
        None => {
            let what = "Modem frames come, but not yet enough of a packet for a picture".into();
            (
                "too-few",
                what,
                "If this lasts, the link loses too much: let the vehicle send less (--bit-rate), or move.",
            )
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn side(key: Option<&str>) -> ThisSide {
        let prior = PriorState { file: "reef.nvsg".into(), identity: "12345678".into() };
        ThisSide { prior, key: key.map(str::to_owned), has_return_path: true }
    }

    fn cause(watch: &Watch, now: f64, refusal: Option<&Refusal>) -> Option<&'static str> {
        watch.missing(now, refusal, &side(None)).map(|missing| missing.cause)
    }

    #[test]
    fn silence_is_told_from_what_cannot_be_read_and_from_too_little() {
        let mut watch = Watch::new(100.0);
        assert_eq!(
            (cause(&watch, 105.0, None), cause(&watch, 110.0, None)),
            (None, Some("no-bytes"))
        );
        (0..19).for_each(|k| watch.came(110.0 + 0.1 * f64::from(k), Some(false)));
        assert_eq!(cause(&watch, 112.0, None), Some("unreadable"), "no picture for long");
        watch.shown(112.0, 12.5);
        assert_eq!(cause(&watch, 113.0, None), None);
        watch.came(113.0, Some(false));
        let told = watch.missing(113.0, None, &side(Some("the key in a.key, epoch 2"))).unwrap();
        assert_eq!(
            told.what,
            "20 modem frames came, none with a valid tag of the key in a.key, epoch 2"
        );
        assert!((told.seconds - 3.0).abs() < 1e-9);
        watch.came(114.0, Some(true));
        assert_eq!(cause(&watch, 115.0, None), None);
        watch.came(130.0, Some(true));
        assert_eq!(cause(&watch, 131.0, None), Some("too-few"));
        assert_eq!(cause(&watch, 131.0, Some(&Refusal::Unknown)), Some("unknown"));
        assert_eq!(cause(&watch, 142.0, None), Some("too-few"));
        assert_eq!(cause(&watch, 143.0, Some(&Refusal::Unknown)), Some("no-bytes"));
    }

    #[test]
    fn another_prior_is_named_with_this_side_s_file() {
        let mut watch = Watch::new(0.0);
        watch.came(11.0, Some(true));
        let told = watch.missing(12.0, Some(&Refusal::OtherPrior(None)), &side(None)).unwrap();
        assert_eq!(told.what, "Packets come about another prior, not about reef.nvsg (12345678)");
    }
}
