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
/// Bits of the first byte that say where an open packet ends.
const PADDED: u8 = 1 << 4;
const CUT: u8 = 1 << 5;

/// Where a packet ends. One that tells that by itself always has `End::Layers`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum End {
    /// With the last layer.
    #[default]
    Layers,
    /// Before it: the last byte of the last layer tells how many bytes of it are not the packet's.
    Padded,
    /// Behind it: the packet's end is not sent.
    Cut,
}

impl End {
    fn bits(self) -> u8 {
        match self {
            End::Layers => 0,
            End::Padded => PADDED,
            End::Cut => CUT,
        }
    }
}

/// What the first layer says of the others, and the user bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Contents<'a> {
    /// The layers after the first. Those beyond `others` are empty.
    pub layers: [Layer; MAX_LAYERS - 1],
    pub others: usize,
    pub user: Option<&'a [u8]>,
    pub end: End,
}

/// Bytes that the layers and so many user bytes take in the first layer.
pub fn contents_len(others: &[Layer], user: Option<usize>) -> usize {
    let layers = others.iter().map(|layer| number_len(layer.threshold) + number_len(layer.chunk));
    1 + layers.sum::<usize>() + user.map_or(0, |user| 1 + user)
}

pub fn put_contents(others: &[Layer], user: Option<&[u8]>, end: End, bytes: &mut Vec<u8>) {
    let flag = if user.is_some() { USER } else { 0 };
    bytes.push(end.bits() | flag | others.len() as u8);
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
    let end = match flags & !(USER | 7) {
        0 => End::Layers,
        PADDED => End::Padded,
        CUT => End::Cut,
        _ => return None,
    };
    let mut contents = Contents { others: usize::from(flags & 7), end, ..Contents::default() };
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
