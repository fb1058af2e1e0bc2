//! A packet to shares.

use crate::packet::{Extent, sound_len};

use super::super::ModemError;
use super::super::error::room;
use super::code::Known;
use super::header::{Header, MAX_SHARES, NUMBERS, PacketHeader, STREAMS, write};
use super::packet::{contents_len, put_contents};
use super::sharing::Sharing;

/// Spreads packets over shares. Keeps its memory from packet to packet: it takes more only for a packet that needs more
/// than all before, and none if it was made [with room](Sharer::with_room).
///
/// ```
/// # fn main() -> Result<(), nvsprior::modem::ModemError> {
/// # let send = |frame: &[u8]| {};
/// # let packet = [
/// #     0xb1, 0x05, 0x04, 0x03, 0x02, 0xed, 0xd0, 0xa5, 0xd4, 0x3f, 0x31, 0x0b, 0x45, 0x13, 0x00,
/// #     0xfc, 0x14, 0xff, 0x6b, 0xe3, 0xf9, 0x94, 0x94, 0x8e, 0x84, 0xa4, 0xa4, 0x24, 0xa8, 0xd9,
/// #     0x61,
/// # ];
/// use nvsprior::modem::{Loss, Sharer, Sharing, SharingOptions};
/// let sharing = Sharing::new(&SharingOptions {
///     mtu: 64,
///     overhead: 0,
///     budget: 200,
///     most: 16,
///     spread: 0,
///     loss: Loss { chance: 0.2, burst: 1.0 },
///     picture: packet.len(),
///     packet: Some(packet.len()),
///     whole: false,
///     user: None,
/// })?;
/// let mut sharer = Sharer::default();
/// sharer.share(&packet, &sharing, 0, None)?;
/// (0..sharer.count()).for_each(|index| send(sharer.get(index)));
/// # Ok(()) }
/// ```
#[derive(Clone, Debug, Default)]
pub struct Sharer {
    /// The chunks of all shares, share by share.
    data: Vec<u8>,
    /// A layer.
    layer: Vec<u8>,
    /// All shares, one after another.
    shares: Vec<u8>,
    share_len: usize,
    scratch: Vec<u8>,
}

impl Sharer {
    /// Takes all memory here that packets of up to so many shares, each of a modem frame, will need.
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
        })
    }

    /// Makes the shares of a packet, of a stream 0 to 3. If the packet is longer than [`Sharing::capacity`], its end is
    /// not sent. If the sharing was made for user bytes, they are given here.
    ///
    /// # Errors
    /// If the bytes are not exactly one packet whose checks match. If the stream is not 0 to 3. If the user bytes are not
    /// as long as the sharing was made for.
    pub fn share(
        &mut self,
        packet: &[u8],
        sharing: &Sharing,
        stream: u8,
        user: Option<&[u8]>,
    ) -> Result<(), ModemError> {
        let extent = Extent::read(packet)?;
        let sound = sound_len(packet);
        if extent.total != Some(packet.len()) || sound != packet.len() {
            return Err(ModemError::Unsound { len: packet.len(), sound });
        }
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
        let (mut rest, mut at) = (packet, 0);
        for (k, layer) in layers.iter().enumerate() {
            self.layer.clear();
            if k == 0 {
                put_contents(&layers[1..], user, &mut self.layer);
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
        self.shares.len().checked_div(self.share_len).unwrap_or(0)
    }

    /// A share, as it goes to the modem.
    ///
    /// # Panics
    /// If the index is not below [`Sharer::count`].
    pub fn get(&self, index: usize) -> &[u8] {
        &self.shares[index * self.share_len..][..self.share_len]
    }
}
