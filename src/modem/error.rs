//! Why a packet cannot be sent, or a modem frame not be taken.

use crate::packet::PacketError;

use super::limits::{MAX_MTU, MAX_SHARES, MAX_UNPROTECTED, MIN_MTU, MIN_SHARE_MTU, STREAMS};

/// Why a packet cannot be sent, or a modem frame not be taken.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ModemError {
    /// The MTU is outside what unprotected packets can have.
    #[error("MTU of {0} bytes: without protection it must lie in {MIN_MTU}..={MAX_MTU}")]
    Mtu(usize),
    /// The bytes are no packet, or no start of one.
    #[error(transparent)]
    Packet(#[from] PacketError),
    /// The packet does not have the length that it states.
    #[error("packet of {found} bytes: it states a length of {stated}")]
    PacketLength {
        /// Bytes given.
        found: usize,
        /// Bytes by the packet's own fields.
        stated: usize,
    },
    /// The packet's own checks do not match all of it.
    #[error("packet of {len} bytes: its checks match only the first {valid}")]
    Invalid {
        /// Length of the packet, bytes.
        len: usize,
        /// Bytes that its checks match.
        valid: usize,
    },
    /// An unprotected packet has more bytes than its shares hold.
    #[error("packet of {len} bytes: the largest for an MTU of {mtu} has {largest}")]
    PacketTooLong {
        /// Length of the packet, bytes.
        len: usize,
        /// The longest one, bytes.
        largest: usize,
        /// The MTU, bytes.
        mtu: usize,
    },
    /// The bytes do not begin as a share does.
    #[error("no share: it begins with {0:#04x}")]
    NotAFrame(u8),
    /// The modem frame ends before its share does: it was cut, or the sender has another MTU.
    #[error("modem frame of {found} bytes, but {needed} are due: cut, or made for another MTU")]
    Cut {
        /// Bytes of the frame.
        found: usize,
        /// Bytes that are due.
        needed: usize,
    },
    /// The share lies beyond the longest packet that there is room for.
    #[error("share {index}: there is room for {room} shares of a packet")]
    NoRoom {
        /// Index of the share.
        index: usize,
        /// Shares that there is room for.
        room: usize,
    },
    /// A share of a packet whose place a newer one has taken. The frame number is modulo 128.
    #[error("packet of frame number {0} modulo 128 comes after a newer one took its place")]
    Late(u32),
    /// The MTU is outside what protected shares can have.
    #[error("MTU of {0} bytes: protected shares need {MIN_SHARE_MTU}..={MAX_MTU}")]
    ShareMtu(usize),
    /// The number of shares is outside what a protected packet may have.
    #[error("{0} shares: a protected packet has 1..={MAX_SHARES}")]
    ShareCount(usize),
    /// The number of shares is outside what an unprotected packet may have.
    #[error("{0} shares: an unprotected packet has 1..={MAX_UNPROTECTED}")]
    UnprotectedCount(usize),
    /// The stream is another than the one that unprotected packets are of.
    #[error("stream {0}: unprotected packets are of stream 0")]
    UnprotectedStream(u8),
    /// The sender has no bit rate, and cannot send shares again in time.
    #[error("reports for a sender without a bit rate")]
    UnpacedReports,
    /// The sender was made without a bit rate.
    #[error("a rate or a loss for a sender that was made without a bit rate")]
    Unpaced,
    /// The loss is none that a link can have.
    #[error(
        "a loss of {0} in bursts of {1}: the chance must lie in 0..1, bursts have 1 frame or more"
    )]
    Loss(f64, f64),
    /// A collector's age is not positive.
    #[error("packets that are stale after {0} seconds: must be a positive time")]
    CollectorAge(f64),
    /// A rate control's option is outside its range.
    #[error(
        "rate control, {field} = {value}: must be positive and finite, and a delay not negative"
    )]
    RateControl {
        /// The option's name.
        field: &'static str,
        /// What it was.
        value: f64,
    },
    /// The user bytes are too many, or not as many as were planned, or the packet is not protected.
    #[error("{0} user bytes: at most 255, as many as were planned, and none without protection")]
    UserBytes(usize),
    /// A time is not finite.
    #[error("a time of {0} seconds: must be finite")]
    Time(f64),
    /// More shares wait than there is room for.
    #[error("{waiting} shares wait, and there is room for {room}: take those that are due")]
    Waiting {
        /// Shares that wait, those of the packet counted.
        waiting: usize,
        /// Shares that there is room for.
        room: usize,
    },
    /// A packet came for which no bytes were planned.
    #[error("no frame was planned: ask for its bytes before its packet is sent")]
    NotPlanned,
    /// No such stream.
    #[error("stream {0}: there are {STREAMS}, from 0 on")]
    Stream(u8),
    /// The budget holds no picture.
    #[error(
        "budget of {budget} bytes: shares of a packet whose picture takes {picture} bytes do not \
         fit; give more bytes, or a larger MTU or more shares if the budget holds the picture"
    )]
    Budget {
        /// Bytes for all shares.
        budget: usize,
        /// Bytes of the packet that make a picture.
        picture: usize,
    },
    /// The check of a share does not match it.
    #[error("a share whose check does not match: damaged, or not a share")]
    ShareCheck,
    /// The check of a report does not match it.
    #[error("a report whose check does not match: damaged, or not a report")]
    ReportCheck,
    /// The MTU holds no report.
    #[error("MTU of {mtu} bytes: a report with its user bytes takes {needed} and more")]
    ReportMtu {
        /// The MTU, bytes.
        mtu: usize,
        /// Fewest bytes of the report.
        needed: usize,
    },
    /// The report is about another stream than the sender's.
    #[error("a report about stream {found}: the sender's is {expected}")]
    ReportStream {
        /// The report's stream.
        found: u8,
        /// The sender's.
        expected: u8,
    },
    /// The sender remembers nothing that a report could be about.
    #[error("a report for a sender that was made without `expect_reports`")]
    NoReports,
    /// The share does not fit the others of its packet.
    #[error("share of frame number {0} modulo 128: unlike the packet's other shares")]
    OtherShare(u32),
    /// The options of a collector are out of range.
    #[error("{field} of {value}: must lie in 1..={max}")]
    Collector {
        /// The option.
        field: &'static str,
        /// What was given.
        value: usize,
        /// The largest value.
        max: usize,
    },
    /// The system does not have the memory that a sender or a collector takes.
    #[error("no memory for modem frames: {0} bytes")]
    Memory(usize),
    /// A packet's start contradicts the one that is there, and its continuations vouch for that one.
    #[error("start of frame number {0}: differs from the one that its packet's checks match")]
    Contradicts(u32),
}
