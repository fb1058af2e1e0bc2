//! How a packet was divided into shares.

use super::sharing::Sharing;

/// How a packet was divided into shares.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Division {
    /// Shares.
    pub shares: usize,
    /// Bytes of each; the last one of an unprotected packet may have fewer.
    pub share_bytes: usize,
    /// Bytes of all their headers and checks.
    pub header_bytes: usize,
    /// Any so many shares yield a picture; of an unprotected packet the first so many.
    pub picture_shares: usize,
    /// So many yield all that is sent.
    pub whole_shares: usize,
    /// Bytes of the packet that are sent. If they are fewer than it has, its end is not sent: it is longer than
    /// planned.
    pub packet_bytes: usize,
    /// Bytes of them that do not travel: the shares state what they say of the frame number, or it is superfluous.
    pub left_out: usize,
    /// Bytes on the link, the overhead of each share counted.
    pub link_bytes: usize,
}

impl Division {
    /// Of a protected packet of `packet` bytes.
    pub fn of(sharing: &Sharing, packet: usize, link_bytes: usize) -> Division {
        let layers = sharing.layers();
        let data: usize = layers.iter().map(|layer| layer.chunk).sum();
        Division {
            shares: sharing.count(),
            share_bytes: sharing.share_len(),
            header_bytes: sharing.count() * (sharing.share_len() - data),
            picture_shares: layers[0].threshold,
            whole_shares: layers[layers.len() - 1].threshold,
            packet_bytes: sharing.capacity().min(packet),
            left_out: 0,
            link_bytes,
        }
    }
}
