//! Packets in the frames of an acoustic modem.
//!
//! A modem carries frames of at most its MTU. It loses some, may swap and repeat others, and may pad every frame to the
//! MTU. A [`Sender`] makes *shares* of packets, which are such modem frames, and a [`Collector`] makes packets of the
//! shares that arrive. Both must be told the same MTU, since no share says it. Shares may come in any order, more than
//! once, padded, or mixed with other frames. Numbers are little endian.
//!
//! A share has one of three forms: *start* and *continuations* of an unprotected packet, and *protected shares*.
//! Reports and [pieces of updates](#updates) are modem frames, too. All bytes: `docs/format/modem.md`.
//!
//! # Without protection
//!
//! [`Protection::None`] and [`Sharer::split`] cut a packet into shares. That costs fewest bytes. If one is lost, those
//! behind it are of no use until it is sent again. MTU: 31 to 65,535 bytes.
//!
//! In the compact profile share 0 holds the latent part, which makes a picture by itself, at any MTU. Such packets are
//! of stream 0, and carry no user bytes.
//!
//! | packet, bytes | MTU 31 | MTU 64 | MTU 256 | MTU 1024 |
//! |---|---|---|---|---|
//! | 31 | 1 share, +0 | 1 share, +0 | 1 share, +0 | 1 share, +0 |
//! | 250 | 10 shares, +36 | 5 shares, +16 | 1 share, +0 | 1 share, +0 |
//! | 750 | 28 shares, +108 | 13 shares, +48 | 3 shares, +8 | 1 share, +0 |
//! | 1500 | 56 shares, +220 | 25 shares, +96 | 6 shares, +20 | 2 shares, +4 |
//! | largest | 110,596 | 245,764 | 1,032,196 | 4,177,924 |
//!
//! **Checks.** The check of a continuation covers share 0 as well. So it binds the share to its packet, and if it
//! matches, it vouches for share 0 too. Up to an MTU of 4095 it finds every error of one, two or any odd number of bits
//! in data and check, and every burst of up to sixteen bits in the data. It misses other damage with a chance of 2⁻¹⁶.
//! With the same chance it takes a continuation for one of another packet, for each packet at hand that lacks the share
//! and whose frame number agrees modulo 4. A packet that is all there must also match its own checks. With the
//! residual's check the chance falls to 2⁻⁴⁸, in the short form to 2⁻³². If only share 0 is there, only what the
//! packet's own checks vouch for counts as valid: the latent part, the camera part, or all of it if the packet ends
//! with share 0.
//!
//! (Share 0 enters through a CRC that is not the latent part's own. The same CRC over bytes that end with it, low byte
//! first, would depend on eight bits of them only.)
//!
//! **The short form** of a packet states its frame number modulo 2¹⁶. The collector completes it to the number modulo
//! 2²⁴ that is nearest to that of the last packet that yielded a picture. If none came before, the 16 bits are the
//! number.
//!
//! **The paper's profile** has a latent part of 43 bytes. Below that MTU, share 0 has no check of its own and yields no
//! picture before share 1.
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
//! A packet in the [predicted form](crate::packet) with a residual is *open*: it does not say where it ends. It ends
//! with the last layer, unless bits of the first layer say that this has padding or that the packet's end is not sent.
//! The check of its latent part is for the decoder to test: it needs the poses that the packet is predicted from.
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
//!
//! # Updates
//!
//! An [update](crate::prior::Update) of the prior travels beside the packets, in *pieces*: one modem frame each. It is
//! cut into *sources*, and by the same Reed–Solomon code as layers into up to 256 pieces, of which any as many as there
//! are sources yield it. The first pieces are the sources. MTU: as for shares; at 16 bytes an update has at most 1,566
//! bytes, at 64 bytes 12,318.
//!
//! **Checks.** A piece has one of its own. Its number and tag bind it to its update. What comes out must have that
//! number and tag, and match the update's own check of 32 bits; else all its pieces are dropped. So pieces of two
//! updates of one number never yield a mixture, but with a chance of 2⁻⁴⁸.
//!
//! **When they go.** [`Sender::push_update`] takes an update, [`Sender::next`] gives out its pieces when no share is
//! due. They get a stated part of the bit rate, [`UpdateOptions::share`], which pictures then do not get; a picture
//! waits for one piece at most. So many go that the update is there with a chance of 99 % at the loss that is assumed;
//! with reports 90 %, as reports ask for more. Without reports all updates are then repeated in turn, in a smaller part
//! of the bit rate. [`Sender::held_update`] tells from when on frames may be drawn with an update.

mod collect;
mod error;
mod limits;
mod memory;
mod report;
mod reported_poses;
mod reported_updates;
mod send;
mod wire;

pub use collect::collected::{Collected, CollectedPacket, CollectorStatistics};
pub use collect::collector::{Collector, CollectorOptions};
pub use error::ModemError;
pub use limits::{MAX_SHARES, MAX_UNPROTECTED, STREAMS};
pub use report::{ArrivedShares, MAX_REPORTED, PacketState, Report, ReportedPacket};
pub use send::division::Division;
pub use send::interleaver::Interleaver;
pub use send::loss::Loss;
pub use send::rate_control::{RateControl, RateControlOptions};
pub use send::sender::{ProcessedReport, Protection, Sender, SenderOptions, SenderStatistics};
pub use send::sharer::Sharer;
pub use send::sharing::{Sharing, SharingOptions};
pub use send::update_options::UpdateOptions;
pub use wire::contents::Layer;
pub use wire::layout::{largest_packet, share_count};

#[cfg(test)]
mod tests;
