//! Packets in the frames of an acoustic modem.
//!
//! A modem carries frames of at most its MTU, here 31 to 65,535 bytes, loses some, may exchange and
//! repeat others, and may fill up every frame to the MTU. A [`Splitter`] cuts a packet into frames,
//! a [`Reassembler`] puts packets together from whatever arrives. Both sides must be told the same
//! MTU; nothing in a frame says it. Numbers are little endian.
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
//! The frame number is the packet's. What comes after the data is padding, of any length and
//! content, which no check covers. So the first frame costs nothing: in the compact profile it
//! holds the latent part, a picture by itself, at any MTU.
//!
//! | packet, bytes | MTU 31 | MTU 64 | MTU 256 | MTU 1024 |
//! |---|---|---|---|---|
//! | 31 | 1 frame, +0 | 1 frame, +0 | 1 frame, +0 | 1 frame, +0 |
//! | 250 | 10 frames, +36 | 5 frames, +16 | 1 frame, +0 | 1 frame, +0 |
//! | 750 | 28 frames, +108 | 13 frames, +48 | 3 frames, +8 | 1 frame, +0 |
//! | 1500 | 56 frames, +220 | 25 frames, +96 | 6 frames, +20 | 2 frames, +4 |
//! | largest | 110,596 | 245,764 | 1,032,196 | 4,177,924 |
//!
//! **Checks.** A later frame's check binds it to its packet by way of frame 0, and where it
//! matches, it vouches for frame 0 too. Up to an MTU of 4095 it finds every error of one, two or
//! any odd number of bits in data and check, and every burst of up to sixteen in the data. Other
//! damage it misses with a chance of 2⁻¹⁶. Of two packets whose frame numbers agree modulo 4, the
//! frames can be taken for each other's with the same chance, then all of them. A packet that is
//! all there must also match its own checks; with that of its residual, 2⁻⁴⁸ is left, of a packet in
//! the short form 2⁻³². Of frame 0
//! alone, what the packet's own checks vouch for counts as sound: the latent part, the camera part,
//! or all where the packet ends with it.
//!
//! (Frame 0 enters by another CRC than the latent part's own: a CRC over bytes that end with the
//! same CRC, low byte first, depends on eight bits of them only.)
//!
//! **The short form** of a packet states its frame number modulo 2¹⁶. Here it is the number modulo 2²⁴
//! nearest to that of the newest packet; before any packet in the full form, the 16 bits themselves.
//!
//! **The paper's profile** has a latent part of 43 bytes. Below that MTU, frame 0 has no check of
//! its own and gives no picture before frame 1.

mod assembly;
mod error;
mod fragment;
mod layout;
mod packet_slot;
mod reassembler;
mod splitter;
mod statistics;
mod waiting;

pub use error::ModemError;
pub use layout::{frame_count, largest_packet};
pub use reassembler::{Reassembler, ReassemblerOptions, Received};
pub use splitter::Splitter;
pub use statistics::{Pushed, Statistics};

#[cfg(test)]
mod tests;
