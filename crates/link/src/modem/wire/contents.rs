//! The layers of a protected packet, and what the first one holds: the other layers, user bytes and the packet's start.

use super::share::{number_len, put_number, take_number};

/// A layer of a protected packet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Layer {
    /// Shares that yield the layer.
    pub threshold: usize,
    /// Bytes of it in each share.
    pub chunk: usize,
}

impl Layer {
    /// Bytes of the layer.
    pub fn len(&self) -> usize {
        self.threshold * self.chunk
    }

    /// Whether the layer is empty.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Most layers of a packet.
pub const MAX_LAYERS: usize = 8;
/// Bit of the first byte: user bytes follow.
const USER: u8 = 1 << 3;
/// Bit of the first byte: the packet's end is not sent.
const CUT: u8 = 1 << 4;

/// What the first layer says of the others, and the user bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Contents<'a> {
    /// The layers after the first. Those beyond `others` are empty.
    pub layers: [Layer; MAX_LAYERS - 1],
    pub others: usize,
    pub user: Option<&'a [u8]>,
    /// The packet's end is not sent.
    pub cut: bool,
}

/// Bytes that the layers and so many user bytes take in the first layer.
pub fn contents_len(others: &[Layer], user: Option<usize>) -> usize {
    let layers = others.iter().map(|layer| number_len(layer.threshold) + number_len(layer.chunk));
    1 + layers.sum::<usize>() + user.map_or(0, |user| 1 + user)
}

pub fn put_contents(others: &[Layer], user: Option<&[u8]>, cut: bool, bytes: &mut Vec<u8>) {
    let flag = if user.is_some() { USER } else { 0 };
    let cut = if cut { CUT } else { 0 };
    bytes.push(cut | flag | others.len() as u8);
    for layer in others {
        put_number(layer.threshold, bytes);
        put_number(layer.chunk, bytes);
    }
    if let Some(user) = user {
        bytes.push(user.len() as u8);
        bytes.extend(user);
    }
}

/// Reads them from the start of the first layer; returns the packet's bytes after them. `None` if they are not what a
/// sender writes: thresholds grow from the first layer's on to at most `count`, and the chunks take `data` bytes.
pub fn take_contents(
    mut bytes: &[u8],
    first: Layer,
    count: usize,
    data: usize,
) -> Option<(Contents<'_>, &[u8])> {
    let (&flags, rest) = bytes.split_first()?;
    bytes = rest;
    if flags & !(CUT | USER | 7) != 0 {
        return None;
    }
    let (others, cut) = (usize::from(flags & 7), flags & CUT != 0);
    let mut contents = Contents { others, cut, ..Contents::default() };
    let (mut threshold, mut taken) = (first.threshold, first.chunk);
    for layer in &mut contents.layers[..contents.others] {
        *layer = Layer { threshold: take_number(&mut bytes)?, chunk: take_number(&mut bytes)? };
        let valid = layer.threshold > threshold && layer.threshold <= count && layer.chunk > 0;
        if !valid {
            return None;
        }
        threshold = layer.threshold;
        taken += layer.chunk;
    }
    if taken != data {
        return None;
    }
    if flags & USER != 0 {
        let (&length, rest) = bytes.split_first()?;
        let (user, rest) = rest.split_at_checked(usize::from(length))?;
        (contents.user, bytes) = (Some(user), rest);
    }
    Some((contents, bytes))
}
