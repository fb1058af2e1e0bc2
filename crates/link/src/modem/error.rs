//! Why a packet cannot be sent, or a modem frame not be taken.

use crate::keys::Refusal;
use nvsprior::ErrorKind;
use nvsprior::packet::PacketError;

use super::limits::{MAX_MTU, MAX_SHARES, MIN_CHECKED_MTU, MIN_MTU, STREAMS};

/// Why a packet cannot be sent, or a modem frame not be taken.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Their texts tell.
pub enum ModemError {
    #[error("MTU of {0} bytes: must lie in {MIN_MTU}..={MAX_MTU}")]
    Mtu(usize),
    #[error(transparent)]
    Packet(#[from] PacketError),
    #[error(transparent)]
    Key(#[from] Refusal),
    #[error("MTU of {mtu} bytes: with these keys it must be {needed} or more")]
    KeyedMtu { mtu: usize, needed: usize },
    #[error("packet of {len} bytes: its checks match only the first {valid}")]
    Invalid { len: usize, valid: usize },
    #[error("packet of {len} bytes: the largest for an MTU of {mtu} has {largest}")]
    PacketTooLong { len: usize, largest: usize, mtu: usize },
    #[error("no share: it begins with {0:#04x}")]
    NotAFrame(u8),
    #[error("modem frame of {found} bytes, but {needed} are due: cut, or made for another MTU")]
    Cut { found: usize, needed: usize },
    #[error("share {index}: there is room for {room} shares of a packet")]
    NoRoom { index: usize, room: usize },
    #[error("packet of number {0} comes after a newer one took its place")]
    Late(u32),
    #[error("MTU of {0} bytes: protected shares need {MIN_CHECKED_MTU}..={MAX_MTU}")]
    ShareMtu(usize),
    #[error("{0} shares: a protected packet has 1..={MAX_SHARES}")]
    ShareCount(usize),
    #[error("{found} shares: an unprotected packet has 1..={max} at this MTU")]
    UnprotectedCount { found: usize, max: usize },
    #[error("stream {0}: unprotected packets are of stream 0")]
    UnprotectedStream(u8),
    #[error("reports for a sender without a bit rate")]
    UnpacedReports,
    #[error("a rate or a loss for a sender that was made without a bit rate")]
    Unpaced,
    #[error(
        "a loss of {0} in bursts of {1}: the chance must lie in 0..1, bursts have 1 frame or more"
    )]
    Loss(f64, f64),
    #[error("packets that are stale after {0} seconds: must be a positive time")]
    CollectorAge(f64),
    #[error(
        "rate control, {field} = {value}: must be positive and finite, and a delay not negative"
    )]
    RateControl { field: &'static str, value: f64 },
    #[error("{0} user bytes: at most 255, as many as were planned, and none without protection")]
    UserBytes(usize),
    #[error("a time of {0} seconds: must be finite")]
    Time(f64),
    #[error("{waiting} shares wait, and there is room for {room}: take those that are due")]
    Waiting { waiting: usize, room: usize },
    #[error("no frame was planned: ask for its bytes before its packet is sent")]
    NotPlanned,
    #[error("stream {0}: there are {STREAMS}, from 0 on")]
    Stream(u8),
    #[error(
        "budget of {budget} bytes: shares of a packet whose picture takes {picture} bytes do not \
         fit; give more bytes, or a larger MTU or more shares if the budget holds the picture"
    )]
    Budget { budget: usize, picture: usize },
    #[error("a share whose check does not match: damaged, or not a share")]
    ShareCheck,
    #[error("a report whose check does not match: damaged, or not a report")]
    ReportCheck,
    #[error("MTU of {mtu} bytes: a report with its user bytes takes {needed} and more")]
    ReportMtu { mtu: usize, needed: usize },
    #[error("a report about stream {found}: the sender's is {expected}")]
    ReportStream { found: u8, expected: u8 },
    #[error("a report for a sender that was made without `expect_reports`")]
    NoReports,
    #[error("share of packet number {0}: unlike the packet's other shares")]
    OtherShare(u32),
    #[error("{field} of {value}: must lie in 1..={max}")]
    Collector { field: &'static str, value: usize, max: usize },
    #[error("no memory for modem frames: {0} bytes")]
    Memory(usize),
    #[error("start of frame number {0}: differs from the one that its packet's checks match")]
    Contradicts(u32),
}

impl ModemError {
    /// What kind of failure it is.
    pub fn kind(&self) -> ErrorKind {
        use ModemError as E;
        match self {
            E::Memory(_) => ErrorKind::Memory,
            E::Key(refusal) => refusal.kind(),
            E::Packet(PacketError::Version) => ErrorKind::Newer,
            E::Loss(..)
            | E::RateControl { .. }
            | E::Collector { .. }
            | E::CollectorAge(_)
            | E::ShareCount(_)
            | E::UnprotectedCount { .. }
            | E::UnprotectedStream(_)
            | E::UnpacedReports
            | E::UserBytes(_)
            | E::Time(_) => ErrorKind::Argument,
            E::Budget { .. } => ErrorKind::Budget,
            E::NotPlanned | E::NoReports | E::Unpaced => ErrorKind::State,
            E::Waiting { .. } => ErrorKind::Unfinished,
            _ => ErrorKind::Modem,
        }
    }
}
