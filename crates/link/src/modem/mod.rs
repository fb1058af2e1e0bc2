//! Packets in the frames of an acoustic modem.
//!
//! A modem carries frames of at most its MTU. It loses some, may swap and repeat others, and may pad every frame to the
//! MTU. A [`Sender`] makes *shares* of packets, which are such modem frames, and a [`Collector`] makes packets of the
//! shares that arrive. Both must be told the same MTU, since no share says it. Shares may come in any order, more than
//! once, padded, or mixed with other frames. Numbers are little endian.
//!
//! A share has one of three forms: *start* and *continuations* of an unprotected packet, and *protected shares*.
//! Reports are modem frames, too. All bytes: `docs/format/modem.md`.
//!
//! # Without protection
//!
//! [`Protection::None`] and [`Sharer::split`] cut a packet into shares. That costs fewest bytes. If one is lost, those
//! behind it are of no use until it is sent again. Such packets are of stream 0, and carry no user bytes. MTU: 8 to
//! 65,535 bytes. [`share_count`] and [`largest_packet`] tell what a packet takes.
//!
//! | MTU | header of the first share | of each later one | check | most shares |
//! |---|---|---|---|---|
//! | 8 to 15 | 1 byte | 1 byte | the modem's | 8 |
//! | 16 and more | 2 bytes, one of them the frame number's low byte | 4 bytes | 16 bits, from the second share on | 2048 |
//!
//! **Checks.** The check of a continuation covers the start as well. So it binds the share to its packet, and if it
//! matches, it vouches for the start too. Up to an MTU of 4095 it finds every error of one, two or any odd number of
//! bits in data and check, and every burst of up to sixteen bits in the data. It misses other damage with a chance of
//! 2⁻¹⁶. With the same chance it takes a continuation for one of another packet, for each packet at hand that lacks the
//! share and whose frame number agrees modulo 4. A packet that is all there must also match its own checks: with the
//! residual's the chance falls to 2⁻³². If only the start is there, only what the packet's own checks vouch for counts
//! as valid. In a start with a predicted pose nothing does: the check of that needs the poses.
//!
//! **Below 16 bytes** the modem must check: all it hands over counts as undamaged, until the packet's own checks tell
//! otherwise.
//!
//! # With protection
//!
//! A packet's bytes go from coarse to fine. So they are divided into *layers*: the first one holds what makes a
//! picture, the later ones what makes it finer. A layer of threshold `m` is cut to `m` chunks, and by a Reed–Solomon
//! code to `count` of them, of which any `m` yield the layer. Each share carries one chunk of each layer. So a lost
//! share costs its part, wherever it lay. This is Priority Encoding Transmission (Albanese, Blömer, Edmonds, Luby and
//! Sudan, IEEE Transactions on Information Theory 42, 1996). [`Sharing`] chooses the layers for the modem's loss. MTU:
//! 16 to 65,535 bytes.
//!
//! The check of a predicted pose is for the decoder to test: it needs the poses that it is predicted from.
//!
//! **Checks.** Each share has one of its own. The packet's first bytes must be the start of a packet, whose latent part
//! has another; a whole packet must match all its checks. If one does not match, all shares of the packet are dropped.
//!
//! # Keys
//!
//! With [keys](crate::keys) each modem frame has a number and a tag in front: [`Sender::with_keys`] and
//! [`Collector::with_keys`]. The collector reads nothing of a frame before its tag is right. What a stranger sends, and
//! what comes a second time, is counted and does no more. The MTU is then the smaller by [`Keys::overhead`]. A modem
//! may fill up such frames with zeros, not with other bytes.
//!
//! [`Keys::overhead`]: crate::keys::Keys::overhead

mod collect;
mod error;
mod limits;
mod memory;
mod report;
mod reported_poses;
mod send;
mod wire;

pub use collect::collected::{Collected, CollectedPacket, CollectorStatistics};
pub use collect::collector::{Collector, CollectorOptions};
pub use error::ModemError;
pub use limits::{MAX_SHARES, MAX_UNPROTECTED, MIN_CHECKED_MTU, MIN_MTU, STREAMS};
pub use report::{ArrivedShares, MAX_REPORTED, PacketState, Report, ReportedPacket};
pub use send::division::Division;
pub use send::interleaver::Interleaver;
pub use send::loss::Loss;
pub use send::rate_control::{RateControl, RateControlOptions};
pub use send::sender::{ProcessedReport, Protection, Sender, SenderOptions, SenderStatistics};
pub use send::sharer::Sharer;
pub use send::sharing::{Sharing, SharingOptions};
pub use wire::contents::Layer;
pub use wire::layout::{largest_packet, share_count};

#[cfg(test)]
mod tests;
