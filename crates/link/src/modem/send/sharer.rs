//! A packet to its shares.

use std::slice::Chunks;

use crate::modem::error::ModemError;
use crate::modem::limits::{MAX_SHARES, MAX_UNPROTECTED, NUMBERS, SMALL_NUMBERS, STREAMS};
use crate::modem::memory::room;
use crate::modem::wire::code::Known;
use crate::modem::wire::contents::{contents_len, put_contents};
use crate::modem::wire::layout::Layout;
use crate::modem::wire::plain::{Continuation, First, Small, TAGS};
use crate::modem::wire::share::{Header, PacketHeader, write};
use crate::modem::wire::travelling::Travelling;
use nvsprior::packet::Extent;

use super::sharing::Sharing;

/// Makes the shares of packets: [`split`](Sharer::split) without protection, [`share`](Sharer::share) with it. Keeps
/// its memory from packet to packet: it takes more only for a packet that needs more than all before.
///
/// ```
/// # fn main() -> Result<(), nvsprior_link::modem::ModemError> {
/// # let send = |frame: &[u8]| {};
/// # let packet = [
/// #     0x00, 0x00, 0x02, 0x00, 0x72, 0x21, 0xfc, 0xff, 0xfc, 0xff, 0xfc, 0xff, 0x0c, 0x40,
/// #     0x06, 0x20, 0x03, 0x10, 0xe1, 0x3f,
/// # ];
/// use nvsprior_link::modem::{Loss, Sharer, Sharing, SharingOptions};
/// let mut sharer = Sharer::default();
/// // The link loses nothing, or the topside asks for what is missing.
/// sharer.split(&packet, 64)?;
/// sharer.shares().for_each(send);
/// // The link loses modem frames.
/// let sharing = Sharing::new(&SharingOptions {
///     mtu: 64,
///     overhead: 0,
///     budget: 200,
///     max_shares: 16,
///     spread: 0,
///     loss: Loss { chance: 0.2, burst: 1.0 },
///     picture: packet.len(),
///     packet: Some(packet.len()),
///     whole: false,
///     user: None,
/// })?;
/// sharer.share(&packet, &sharing, 0, None)?;
/// sharer.shares().for_each(send);
/// # Ok(()) }
/// ```
#[derive(Clone, Debug, Default)]
pub struct Sharer {
    /// The chunks of all protected shares, share by share.
    data: Vec<u8>,
    layer: Vec<u8>,
    /// All shares, one after another.
    shares: Vec<u8>,
    /// Bytes of each; the last one may be shorter.
    share_len: usize,
    scratch: Vec<u8>,
    /// What travels of the packet.
    sent: Vec<u8>,
    /// Packets that went in small modem frames.
    small: u32,
}

impl Sharer {
    /// Takes all memory here that protected packets of up to so many shares, each of a modem frame, will need.
    ///
    /// # Errors
    /// If the system does not have it.
    pub fn with_room(mtu: usize, shares: usize) -> Result<Sharer, ModemError> {
        let all = shares.min(MAX_SHARES).saturating_mul(mtu);
        Ok(Sharer {
            data: room(all)?,
            layer: room(all)?,
            shares: room(all)?,
            share_len: 0,
            scratch: room(mtu)?,
            sent: room(all)?,
            small: 0,
        })
    }

    /// Takes all memory here that unprotected packets of up to so many shares will need.
    ///
    /// # Errors
    /// If the system does not have it.
    pub fn with_room_unprotected(mtu: usize, shares: usize) -> Result<Sharer, ModemError> {
        let all = shares.min(MAX_UNPROTECTED).saturating_mul(mtu);
        Ok(Sharer { shares: room(all)?, sent: room(all)?, ..Sharer::default() })
    }

    /// Makes the unprotected shares of a packet, for modem frames of at most `mtu` bytes.
    ///
    /// # Errors
    /// If the MTU is outside 8 to 65,535 bytes. If the bytes are not exactly one packet whose checks match. If the
    /// packet is longer than [`largest_packet`](crate::modem::largest_packet).
    pub fn split(&mut self, packet: &[u8], mtu: usize) -> Result<(), ModemError> {
        let layout = Layout::new(mtu)?;
        let first = *packet.first().ok_or(ModemError::Invalid { len: 0, valid: 0 })?;
        let len = packet.len() - layout.travelling().left_out(first).len().min(packet.len());
        let count = layout.count_of(len, layout.max_shares())?;
        self.split_start(packet, layout, count)
    }

    /// Makes the first `count` of them.
    pub(in crate::modem) fn split_start(
        &mut self,
        packet: &[u8],
        layout: Layout,
        count: usize,
    ) -> Result<(), ModemError> {
        let extent = check(packet)?;
        self.sent.clear();
        self.sent.extend(layout.travelling().of(packet));
        let all = layout.count(self.sent.len());
        self.share_len = layout.mtu;
        self.shares.clear();
        match layout.is_small() {
            true => self.write_small(layout, count, all),
            false => self.write_plain(layout, count, all, extent.frame),
        }
        Ok(())
    }

    /// Writes the first `count` of `all` shares.
    fn write_plain(&mut self, layout: Layout, count: usize, all: usize, frame: u32) {
        let data = |index| &self.sent[layout.range(index, self.sent.len())];
        let (number, last) = (frame % NUMBERS, all == 1);
        let first = First { number, last, data: data(0) };
        let (binding, tag) = (first.binding(), frame as usize % TAGS);
        self.shares.extend(First::header(number, last));
        self.shares.extend(first.data);
        for index in 1..count {
            let (last, data) = (index + 1 == all, data(index));
            let later = Continuation { tag, index, last, check: 0, data };
            self.shares.extend(later.header(binding));
            self.shares.extend(data);
        }
    }

    /// The same in small modem frames.
    fn write_small(&mut self, layout: Layout, count: usize, all: usize) {
        for index in 0..count {
            self.shares.push(Small::header(self.small, index, index + 1 == all));
            self.shares.extend(&self.sent[layout.range(index, self.sent.len())]);
        }
        self.small = (self.small + 1) % SMALL_NUMBERS;
    }

    /// Makes the protected shares of a packet, of a stream 0 to 3. If the packet is longer than [`Sharing::capacity`],
    /// its end is not sent. If the sharing was made for user bytes, they are given here.
    ///
    /// # Errors
    /// If the bytes are not exactly one packet whose checks match. If the stream is not 0 to 3. If the user bytes are
    /// not as long as the sharing was made for.
    pub fn share(
        &mut self,
        packet: &[u8],
        sharing: &Sharing,
        stream: u8,
        user: Option<&[u8]>,
    ) -> Result<(), ModemError> {
        let extent = check(packet)?;
        if stream >= STREAMS {
            return Err(ModemError::Stream(stream));
        }
        let layers = sharing.layers();
        if contents_len(&layers[1..], user.map(<[u8]>::len)) != sharing.head() {
            return Err(ModemError::UserBytes(user.map_or(0, <[u8]>::len)));
        }
        let count = sharing.count();
        let data_len = layers.iter().map(|layer| layer.chunk).sum::<usize>();
        self.data.clear();
        self.data.resize(count * data_len, 0);
        self.sent.clear();
        self.sent.extend(Travelling::Wide.of(packet));
        let cut = sharing.capacity() < self.sent.len();
        self.sent.truncate(sharing.capacity());
        let (mut rest, mut at) = (&self.sent[..], 0);
        for (k, layer) in layers.iter().enumerate() {
            self.layer.clear();
            if k == 0 {
                put_contents(&layers[1..], user, cut, &mut self.layer);
            }
            let taken = (layer.len() - self.layer.len()).min(rest.len());
            self.layer.extend(&rest[..taken]);
            rest = &rest[taken..];
            self.layer.resize(layer.len(), 0);
            let chunk = |index: usize| &self.layer[index * layer.chunk..][..layer.chunk];
            let known = Known::new(0..layer.threshold);
            for (index, share) in self.data.chunks_exact_mut(data_len).enumerate() {
                let share = &mut share[at..at + layer.chunk];
                match index < layer.threshold {
                    true => share.copy_from_slice(chunk(index)),
                    false => known.write(index, chunk, share),
                }
            }
            at += layer.chunk;
        }
        let header = PacketHeader {
            stream,
            number: extent.frame % NUMBERS,
            count,
            threshold: layers[0].threshold,
            chunk: layers[0].chunk,
            others: data_len - layers[0].chunk,
        };
        self.write(header, data_len);
        Ok(())
    }

    fn write(&mut self, packet: PacketHeader, data_len: usize) {
        self.shares.clear();
        for (index, data) in self.data.chunks_exact(data_len).enumerate() {
            write(&Header { packet, index }, data, &mut self.scratch);
            self.share_len = self.scratch.len();
            self.shares.extend(&self.scratch);
        }
    }

    /// Number of shares; 0 before the first packet.
    pub fn count(&self) -> usize {
        self.shares().len()
    }

    /// The shares, as they go to the modem.
    pub fn shares(&self) -> Chunks<'_, u8> {
        self.shares.chunks(self.share_len.max(1))
    }

    /// A share, as it goes to the modem.
    ///
    /// # Panics
    /// If the index is not below [`Sharer::count`].
    pub fn get(&self, index: usize) -> &[u8] {
        let share = self.shares().nth(index);
        share.unwrap_or_else(|| panic!("share {index} of {}", self.count()))
    }
}

/// Reads the start of what must be exactly one packet whose checks all match.
fn check(packet: &[u8]) -> Result<Extent, ModemError> {
    let extent = Extent::read(packet)?;
    match extent.whole {
        Some(len) if len == packet.len() => Ok(extent),
        _ => Err(ModemError::Invalid { len: packet.len(), valid: extent.valid }),
    }
}
