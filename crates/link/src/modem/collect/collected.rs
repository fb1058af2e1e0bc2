//! What a collector says of modem frames and packets.

/// What a modem frame has brought. The first number is the stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Collected {
    /// The packet of this stream and frame number is complete: [`CollectedPacket::frame`].
    Complete(u8, u32),
    /// It has more bytes than before.
    Grown(u8, u32),
    /// The share is kept. It is of use once more come.
    Kept,
    /// The share was there before.
    Duplicate,
    /// The share's packet was complete before.
    Surplus,
    /// The packet's own checks do not match what its shares hold. Its shares are dropped, except an unprotected
    /// packet's start, as far as that is valid. The number is the one that shares state.
    Damaged(u8, u32),
}

/// Counts since the start. Modem frames that came = accepted + duplicates + rejected + waiting + foreign + replayed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CollectorStatistics {
    /// Shares that became part of a packet, and such that were surplus.
    pub accepted: u64,
    /// Shares that were there before.
    pub duplicates: u64,
    /// Modem frames that were no shares, damaged ones, such of packets long past, and continuations that no packet came
    /// for.
    pub rejected: u64,
    /// Continuations whose packet has not come yet. Not a count since the start.
    pub waiting: u64,
    /// Shares that packets gone by had, of those accepted.
    pub arrived: u64,
    /// Shares that packets gone by were sent in. With `arrived` it tells the loss. Packets of which no share came do
    /// not count: a frame that was left out looks the same. So the loss is a little more, by as much as whole packets
    /// are lost. Nor do unprotected packets whose length did not come.
    pub sent: u64,
    /// Packets that became complete.
    pub completed: u64,
    /// Packets gone by that were complete although shares of them were missing.
    pub repaired: u64,
    /// Packets gone by that yielded a picture, but not all of it.
    pub partial: u64,
    /// Packets gone by that yielded no picture, and frames of which nothing came.
    pub lost: u64,
    /// Packets whose own checks did not match what their shares held.
    pub damaged: u64,
    /// Modem frames whose tag no key has made: see [`Collector::with_keys`](crate::modem::Collector::with_keys).
    pub foreign: u64,
    /// Modem frames that came a second time, with keys.
    pub replayed: u64,
}

/// What has come of a packet.
#[derive(Clone, Copy, Debug)]
pub struct CollectedPacket<'a> {
    /// Frame number: of those that end in the stated bits, the one nearest to that of the packet before it.
    pub frame: u32,
    /// The packet's first bytes. Checks vouch for them: decode them with
    /// [`Trust::Start`](nvsprior::Trust::Start).
    pub bytes: &'a [u8],
    /// The bytes are the whole packet, and its checks match.
    pub complete: bool,
    /// No share brings more: the packet is complete, or its end was not sent.
    pub ended: bool,
    /// User bytes that came with it.
    pub user: Option<&'a [u8]>,
    /// Shares that came.
    pub arrived: usize,
    /// Shares that it was sent in; `None` before an unprotected packet's length has come.
    pub sent: Option<usize>,
}
