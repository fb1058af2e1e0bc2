//! The pieces of an update: modem frames of which enough, whichever they are, yield it.

use crate::modem::error::ModemError;
use crate::modem::limits::MAX_SOURCES;
use crate::packet::bytes::crc16;

use super::share::{number_len, put_number, take_number};

/// The first byte of a piece, without its stream.
pub const PIECE: u8 = 0b0000_1000;
/// Which bits of the first byte are not the stream's.
const MARKED: u8 = 0b1100_1111;
const STREAM_SHIFT: u8 = 4;
/// Bytes of an update that its check does not cover: the check itself, at the end.
const CHECK: usize = 4;
/// Where an update states its number.
const NUMBER_AT: usize = 9;

/// What tells an update from others: the low bits of its number and of its own check.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct UpdateName {
    /// Modulo 256.
    pub number: u8,
    /// Modulo 2¹⁶.
    pub tag: u16,
}

impl UpdateName {
    /// Of an update as it travels; `None` if its check does not match.
    pub fn of(update: &[u8]) -> Option<UpdateName> {
        let (content, check) = update.split_last_chunk::<CHECK>()?;
        let number = *content.get(NUMBER_AT)?;
        let matches = u32::from_le_bytes(*check) == crc32fast::hash(content);
        matches.then_some(UpdateName { number, tag: u16::from_le_bytes([check[0], check[1]]) })
    }
}

/// How an update is cut: its length and its bytes, and zeros up to `sources` chunks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cut {
    /// Pieces that yield the update, 1 to [`MAX_SOURCES`].
    pub sources: usize,
    /// Bytes of the update in each.
    pub chunk: usize,
}

impl Cut {
    /// Of an update of `len` bytes into so many sources.
    pub fn new(len: usize, sources: usize) -> Cut {
        Cut { sources, chunk: (number_len(len) + len).div_ceil(sources) }
    }

    /// Bytes of all sources.
    pub fn len(self) -> usize {
        self.sources * self.chunk
    }

    /// Bytes of a piece.
    pub fn piece_len(self) -> usize {
        FIXED + number_len(self.chunk) + self.chunk
    }
}

/// Bytes of a piece's header but the chunk's length.
const FIXED: usize = 8;
/// Fewest bytes of a piece.
pub const MIN_LEN: usize = FIXED + 2;

/// Most bytes of an update in a piece of at most `mtu` bytes.
pub fn largest_chunk(mtu: usize) -> usize {
    let with = |len| mtu.saturating_sub(FIXED + len);
    (1..=3).map(with).find(|chunk| FIXED + number_len(*chunk) + chunk <= mtu).unwrap_or(0)
}

/// What a piece says of itself and of its update.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PieceHeader {
    pub stream: u8,
    pub update: UpdateName,
    pub cut: Cut,
    /// Which piece it is, 0 to 255. The first ones are the sources.
    pub index: usize,
}

/// Whether a modem frame's first byte is that of a piece.
pub fn is_piece(first: u8) -> bool {
    first & MARKED == PIECE
}

/// Appends an update's sources.
pub fn put_sources(update: &[u8], cut: Cut, into: &mut Vec<u8>) {
    let end = into.len() + cut.len();
    put_number(update.len(), into);
    into.extend(update);
    into.resize(end, 0);
}

/// The update in its sources; `None` if it is not the one that is named.
pub fn take_update(mut sources: &[u8], name: UpdateName) -> Option<&[u8]> {
    let len = take_number(&mut sources)?;
    let (update, rest) = sources.split_at_checked(len)?;
    let padded = rest.iter().all(|byte| *byte == 0);
    (padded && UpdateName::of(update) == Some(name)).then_some(update)
}

/// Writes a piece in place of what `piece` held; `fill` writes its chunk.
pub fn write(header: &PieceHeader, piece: &mut Vec<u8>, fill: impl FnOnce(&mut [u8])) {
    let PieceHeader { stream, update, cut, index } = *header;
    let [low, high] = update.tag.to_le_bytes();
    let sources = (cut.sources - 1) as u8;
    piece.clear();
    piece.extend([PIECE | stream << STREAM_SHIFT, update.number, low, high, sources, index as u8]);
    put_number(cut.chunk, piece);
    let head = piece.len();
    piece.resize(head + 2 + cut.chunk, 0);
    fill(&mut piece[head + 2..]);
    let check = crc16(&[&piece[..head], &piece[head + 2..]]);
    piece[head..head + 2].copy_from_slice(&check.to_le_bytes());
}

/// Reads a piece. Returns its header and its chunk. Padding may follow.
pub fn read(piece: &[u8]) -> Result<(PieceHeader, &[u8]), ModemError> {
    let cut_at = |needed| ModemError::Cut { found: piece.len(), needed };
    let &[first, number, low, high, sources, index, ref rest @ ..] = piece else {
        return Err(cut_at(MIN_LEN));
    };
    if !is_piece(first) {
        return Err(ModemError::NotAFrame(first));
    }
    let mut rest = rest;
    let chunk = take_number(&mut rest).ok_or_else(|| cut_at(MIN_LEN))?;
    let head = piece.len() - rest.len();
    let needed = head + 2 + chunk;
    let (check, data) = rest.split_first_chunk::<2>().ok_or_else(|| cut_at(needed))?;
    let data = data.get(..chunk).ok_or_else(|| cut_at(needed))?;
    if crc16(&[&piece[..head], data]) != u16::from_le_bytes(*check) {
        return Err(ModemError::ShareCheck);
    }
    let cut = Cut { sources: usize::from(sources) + 1, chunk };
    if cut.sources > MAX_SOURCES || chunk == 0 {
        return Err(ModemError::NotAFrame(first));
    }
    let update = UpdateName { number, tag: u16::from_le_bytes([low, high]) };
    let stream = first >> STREAM_SHIFT & 3;
    Ok((PieceHeader { stream, update, cut, index: index.into() }, data))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn header(chunk: usize) -> PieceHeader {
        let update = UpdateName { number: 3, tag: 0xBEEF };
        PieceHeader { stream: 2, update, cut: Cut { sources: 20, chunk }, index: 255 }
    }

    fn written(chunk: usize) -> Vec<u8> {
        let mut piece = vec![7; 5];
        write(&header(chunk), &mut piece, |data| data.fill(0x5A));
        piece
    }

    #[test]
    fn what_is_written_is_read() {
        for chunk in [1, 127, 128, 20_000] {
            let mut piece = written(chunk);
            assert_eq!(piece.len(), header(chunk).cut.piece_len());
            let data = vec![0x5A; chunk];
            assert_eq!(read(&piece), Ok((header(chunk), &data[..])));
            piece.extend([0xFF; 9]);
            assert_eq!(read(&piece), Ok((header(chunk), &data[..])), "padded");
        }
    }

    #[test]
    fn damage_is_found() {
        let piece = written(40);
        for bit in 0..8 * piece.len() {
            let mut damaged = piece.clone();
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert!(read(&damaged).is_err(), "bit {bit}");
        }
        for len in 0..piece.len() {
            assert!(matches!(read(&piece[..len]), Err(ModemError::Cut { .. })), "cut to {len}");
        }
    }

    #[test]
    fn chunks_fill_the_mtu() {
        for mtu in (16..400).chain([16_000, 16_393, 16_394, 16_395, 16_396, 65_535]) {
            let chunk = largest_chunk(mtu);
            assert!(Cut { sources: 1, chunk }.piece_len() <= mtu, "{mtu}");
            assert!(Cut { sources: 1, chunk: chunk + 1 }.piece_len() > mtu, "{mtu}");
        }
        assert_eq!(largest_chunk(16), 7);
    }

    #[test]
    fn an_update_comes_out_of_its_sources() {
        let content: Vec<u8> = (0..90).collect();
        let update = [&content[..], &crc32fast::hash(&content).to_le_bytes()].concat();
        let name = UpdateName::of(&update).unwrap();
        assert_eq!(name.number, 9);
        for sources in [1, 2, 13, 94, 95, 200] {
            let cut = Cut::new(update.len(), sources);
            let mut bytes = vec![1, 2];
            put_sources(&update, cut, &mut bytes);
            assert_eq!(bytes.len(), 2 + cut.len());
            assert_eq!(take_update(&bytes[2..], name), Some(&update[..]));
            let other = UpdateName { tag: name.tag ^ 1, ..name };
            assert_eq!(take_update(&bytes[2..], other), None);
            bytes[40] ^= 8;
            assert_eq!(take_update(&bytes[2..], name), None);
        }
    }

    proptest! {
        #[test]
        fn any_bytes_are_read_or_refused(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
            let mut bytes = bytes;
            if let Some(first) = bytes.first_mut() {
                *first = PIECE;
            }
            if let Ok((header, data)) = read(&bytes) {
                let mut again = Vec::new();
                write(&header, &mut again, |chunk| chunk.copy_from_slice(data));
                prop_assert_eq!(read(&again), Ok((header, data)));
            }
        }
    }
}
