//! Packets in the frames of an acoustic modem.
//!
//! A modem carries frames of at most its MTU, here 31 to 65,535 bytes. It loses some frames, may
//! swap and repeat others, and may pad every frame to the MTU. A [`Splitter`] cuts a packet into
//! frames. A [`Reassembler`] puts packets together from what arrives. Both sides must be told the
//! same MTU; nothing in a frame says it. Numbers are little endian.
//!
//! If frames are lost, a [`Sender`] is better: it spreads packets over frames of which any few give a picture, and a
//! [`Collector`] puts them together. Below is the splitter's way.
//!
//! | byte | frame 0 |
//! |---|---|
//! | 0–… | the packet's first bytes, as many as the MTU, or all; the high two bits are `10` |
//!
//! | byte | frames 1 to 4095 |
//! |---|---|
//! | 0 | from the top: two bits `11`, two bits frame number modulo 4, four bits index high |
//! | 1 | index low byte |
//! | 2–3 | CRC-16/IBM-3740 of: CRC-32 (IEEE) of frame 0, bytes 0–1, the data |
//! | 4–… | data: the packet's next MTU − 4 bytes, or its rest |
//!
//! The frame number is the packet's. Padding follows the data. It has any length and content, and
//! no check covers it. The first frame has no header, so it costs nothing. In the compact profile
//! it holds the latent part, which makes a picture by itself, at any MTU.
//!
//! | packet, bytes | MTU 31 | MTU 64 | MTU 256 | MTU 1024 |
//! |---|---|---|---|---|
//! | 31 | 1 frame, +0 | 1 frame, +0 | 1 frame, +0 | 1 frame, +0 |
//! | 250 | 10 frames, +36 | 5 frames, +16 | 1 frame, +0 | 1 frame, +0 |
//! | 750 | 28 frames, +108 | 13 frames, +48 | 3 frames, +8 | 1 frame, +0 |
//! | 1500 | 56 frames, +220 | 25 frames, +96 | 6 frames, +20 | 2 frames, +4 |
//! | largest | 110,596 | 245,764 | 1,032,196 | 4,177,924 |
//!
//! **Checks.** The check of a later frame covers frame 0 as well. So it binds the frame to its packet, and if it
//! matches, it vouches for frame 0 too. Up to an MTU of 4095 it finds every error of one, two or any odd number of bits
//! in data and check, and every burst of up to sixteen bits in the data. It misses other damage with a chance of 2⁻¹⁶.
//! If the frame numbers of two packets agree modulo 4, their frames can be confused with the same chance, and then all
//! of them are. A packet that is all there must also match its own checks. With the residual's check the chance falls
//! to 2⁻⁴⁸, in the short form to 2⁻³². If only frame 0 is there, only what the packet's own checks vouch for counts as
//! sound: the latent part, the camera part, or all of it if the packet ends with frame 0.
//!
//! (Frame 0 enters through a CRC that is not the latent part's own. The same CRC over bytes that
//! end with it, low byte first, would depend on eight bits of them only.)
//!
//! **The short form** of a packet states its frame number modulo 2¹⁶. The reassembler completes it to the number modulo
//! 2²⁴ that is nearest to the newest packet's. If no packet came before, the 16 bits are the number.
//!
//! **The paper's profile** has a latent part of 43 bytes. Below that MTU, frame 0 has no check of
//! its own and gives no picture before frame 1.

mod assembly;
mod error;
mod fragment;
mod history;
mod interleaver;
mod layout;
mod packet_slot;
mod rate_control;
mod reassembler;
mod report;
mod sender;
mod shares;
mod splitter;
mod statistics;
mod waiting;

pub use error::ModemError;
pub use interleaver::Interleaver;
pub use layout::{frame_count, largest_packet};
pub use rate_control::{RateControl, RateControlOptions};
pub use reassembler::{Reassembler, ReassemblerOptions, Received};
pub use report::{ArrivedShares, MOST_TOLD, PacketState, Report, ToldPacket};
pub use sender::{Heard, Sender, SenderOptions, SenderStatistics};
pub use shares::{
    Collected, CollectedPacket, Collector, CollectorOptions, Layer, Loss, MAX_SHARES, STREAMS,
    ShareStatistics, Sharer, Sharing, SharingOptions,
};
pub use splitter::Splitter;
pub use statistics::{Pushed, Statistics};

#[cfg(test)]
mod tests;
