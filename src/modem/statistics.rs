//! What becomes of the frames that are pushed.

/// What a frame has brought; the numbers are frame numbers, modulo 2²⁴.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pushed {
    /// This packet is complete.
    Complete(u32),
    /// This packet has more sound bytes at its start than before.
    Grown(u32),
    /// The frame is kept, and of use once others come: one before it is missing, its first frame,
    /// or its packet's length.
    Kept,
    /// The frame was there.
    Duplicate,
    /// All frames of this packet are there and its own checks do not match: the first frame stays,
    /// as far as it is sound; the others are forgotten and may come again.
    Damaged(u32),
}

/// Counts since the start. Frames pushed = accepted + duplicates + rejected + waiting.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Statistics {
    /// Frames that became part of a packet.
    pub accepted: u64,
    /// Frames that were there.
    pub duplicates: u64,
    /// Frames refused, or dropped because no packet came that they belong to.
    pub rejected: u64,
    /// Frames that belong to no packet yet. Not a count since the start.
    pub waiting: u64,
    /// Packets completed.
    pub completed: u64,
    /// Times that a packet was all there and its own checks did not match.
    pub damaged: u64,
    /// Packets displaced by newer ones before they were complete.
    pub incomplete: u64,
}
