//! Why a packet cannot be split, or a frame not be taken.

use crate::packet::PacketError;

use super::layout::{LARGEST_MTU, SMALLEST_MTU};
use super::shares::{MAX_SHARES, STREAMS};

/// Why a packet cannot be split, or a frame not be taken.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ModemError {
    /// The MTU is outside what frames are made for.
    #[error("MTU of {0} bytes: it must lie in {SMALLEST_MTU}..={LARGEST_MTU}")]
    Mtu(usize),
    /// The bytes are no packet, or no first frame of one.
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
    #[error("packet of {len} bytes: its checks match only the first {sound}")]
    Unsound {
        /// Length of the packet, bytes.
        len: usize,
        /// Bytes that its checks match.
        sound: usize,
    },
    /// The packet has more bytes than fit into 4096 frames.
    #[error("packet of {len} bytes: the largest for an MTU of {mtu} has {largest}")]
    PacketTooLong {
        /// Length of the packet, bytes.
        len: usize,
        /// Longest that can be split, bytes.
        largest: usize,
        /// The MTU, bytes.
        mtu: usize,
    },
    /// The packet has no frame of this index.
    #[error("frame {index} of a packet of {count}")]
    NoSuchFrame {
        /// The index.
        index: usize,
        /// Frames of the packet.
        count: usize,
    },
    /// A frame does not fit the buffer given for it.
    #[error("buffer of {found} bytes for a frame of {needed}")]
    Buffer {
        /// Bytes of the frame.
        needed: usize,
        /// Bytes of the buffer.
        found: usize,
    },
    /// The bytes do not begin as a frame does.
    #[error("no frame: it begins with {0:#04x}")]
    NotAFrame(u8),
    /// The frame ends before its packet's bytes do: it was cut, or the sender has another MTU.
    #[error("frame of {found} bytes, but {needed} are due: cut, or split for another MTU")]
    Cut {
        /// Bytes of the frame.
        found: usize,
        /// Bytes that are due.
        needed: usize,
    },
    /// The frame lies beyond the longest packet that there is room for.
    #[error("frame {index}: there is room for {room} frames of a packet")]
    NoRoom {
        /// Index of the frame.
        index: usize,
        /// Frames that there is room for.
        room: usize,
    },
    /// The first frame of a packet whose place a newer one has taken.
    #[error("packet of frame number {0} comes again after a newer one took its place")]
    Late(u32),
    /// The MTU is outside what shares are made for.
    #[error("MTU of {0} bytes: shares need 16..={LARGEST_MTU}")]
    ShareMtu(usize),
    /// The number of shares is outside what a packet may have.
    #[error("{0} shares: a packet has 1..={MAX_SHARES}")]
    ShareCount(usize),
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
    /// The user bytes are too many, or not as many as the sharing was made for.
    #[error("{0} user bytes: at most 255, and as many as the sharing was made for")]
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
        /// Least bytes of the report.
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
    #[error("a report for a sender that was made without `answers`")]
    NoAnswers,
    /// The share does not fit the others of its packet.
    #[error("share of frame number {0} modulo 128: unlike the packet's other shares")]
    OtherShare(u32),
    /// The options of a collector are out of range.
    #[error("{field} of {value}: must lie in 1..={most}")]
    Collector {
        /// The option.
        field: &'static str,
        /// What was given.
        value: usize,
        /// The largest value.
        most: usize,
    },
    /// The system does not have the memory that a sender, a reassembler or a collector takes.
    #[error("no memory for modem frames: {0} bytes")]
    Memory(usize),
    /// The first frame contradicts the one that is there, and later frames vouch for that one.
    #[error("first frame of frame number {0}: differs from the one that its packet's checks match")]
    Contradicts(u32),
}

/// An empty list with room for so many values, in memory that may be refused.
pub(super) fn room<T>(count: usize) -> Result<Vec<T>, ModemError> {
    let mut values = Vec::new();
    let refused = |_| ModemError::Memory(count.saturating_mul(size_of::<T>()));
    values.try_reserve_exact(count).map_err(refused)?;
    Ok(values)
}

/// `count` values, in memory that may be refused.
pub(super) fn filled<T: Clone>(count: usize, value: T) -> Result<Vec<T>, ModemError> {
    let mut values = room(count)?;
    values.resize(count, value);
    Ok(values)
}
