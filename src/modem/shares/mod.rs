//! Packets as *shares*: modem frames of which any few give the picture, and each more a finer one.
//!
//! With a [`Splitter`](super::Splitter) all bytes behind a lost modem frame are useless. Here a packet is spread over
//! `count` shares instead. Its bytes go from coarse to fine. So they are divided into *layers*: the first one holds what
//! makes a picture, the later ones what makes it finer. A layer of threshold `m` is cut to `m` chunks, and by a
//! Reed–Solomon code to `count` of them, of which any `m` give the layer back. Each share carries one chunk of each
//! layer. So a lost share costs its part, wherever it lay. This is Priority Encoding Transmission (Albanese, Blömer,
//! Edmonds, Luby and Sudan, IEEE Transactions on Information Theory 42, 1996). [`Sharing`] chooses the layers for the
//! modem's loss.
//!
//! A share says what it is. So the topside needs to be told nothing but the modem's MTU, and shares may come in any
//! order, more than once, padded, or mixed with the frames of a splitter. Numbers are little endian.
//!
//! | byte | share |
//! |---|---|
//! | 0 | from the top: two bits `01`, two bits stream, the number's four high bits |
//! | 1 | from the top: the number's three low bits, one bit wide, four bits threshold of the first layer − 1 |
//! | 2 | narrow: four bits index, four bits count − 1. Wide: index; the next byte is count − 1 |
//! | next | first layer's chunk, bytes: seven bits per byte, low bits first, high bit set on all but the last |
//! | next | bytes of the other layers' chunks together, likewise |
//! | next 2 | CRC-16/IBM-3740 of all other bytes of the share |
//! | … | the chunks, first layer first |
//!
//! The number is the packet's frame number modulo 128. Padding may follow.
//!
//! | bytes | first layer |
//! |---|---|
//! | 1 | low three bits: number of other layers; bit 3: user bytes follow; the others are 0 |
//! | 2 and more per layer | threshold and chunk, in bytes, as the chunk above |
//! | 1 + length | length of the user bytes, and they; if bit 3 is set |
//! | … | the packet's first bytes |
//!
//! The other layers hold the packet's next bytes. After its last one there may be zeros.
//!
//! **Checks.** Each share has one of its own. The packet's first bytes must be the start of a packet, whose latent part
//! has another; a whole packet must match all its checks. If one does not match, all shares of the packet are dropped.

mod chain;
mod code;
mod collector;
mod header;
mod packet;
mod sharer;
mod sharing;

pub use chain::Loss;
pub use collector::{Collected, CollectedPacket, Collector, CollectorOptions, ShareStatistics};
pub use header::{MAX_SHARES, STREAMS};
pub use sharer::Sharer;
pub use sharing::{Layer, Sharing, SharingOptions};

#[cfg(test)]
mod tests;
