//! The first bytes of a protected share.

use crate::modem::error::ModemError;
use crate::modem::limits::NUMBERS;
use nvsprior::packet::crc16;

/// High two bits of a protected share.
pub const SHARE: u8 = 0b01;
/// Largest threshold of the first layer.
pub const MAX_FIRST: usize = 8;
/// Up to this many shares have short headers.
const NARROW: usize = 16;

/// What a share says of itself and of its packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    pub packet: PacketHeader,
    pub index: usize,
}

/// What all shares of a packet say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PacketHeader {
    pub stream: u8,
    /// Frame number modulo [`NUMBERS`].
    pub number: u32,
    pub count: usize,
    /// Threshold of the first layer.
    pub threshold: usize,
    /// Bytes of the first layer's chunk.
    pub chunk: usize,
    /// Bytes of the other layers' chunks.
    pub others: usize,
}

impl PacketHeader {
    /// Bytes of the chunks.
    pub fn data_len(&self) -> usize {
        self.chunk + self.others
    }
}

/// Bytes of a header, its check counted.
pub fn header_len(count: usize, chunk: usize, others: usize) -> usize {
    let ends = if count > NARROW { 4 } else { 3 };
    ends + number_len(chunk) + number_len(others) + 2
}

/// Writes a share to the start of `share`, with its data. Returns its length.
pub fn write(header: &Header, data: &[u8], share: &mut Vec<u8>) {
    let Header { packet, index } = header;
    let wide = packet.count > NARROW;
    let number = packet.number % NUMBERS;
    share.clear();
    share.push(SHARE << 6 | packet.stream << 4 | (number >> 4) as u8);
    let threshold = (packet.threshold - 1) as u8;
    share.push(((number & 0xF) as u8) << 4 | u8::from(wide) << 3 | threshold);
    let (index, last) = (*index as u8, (packet.count - 1) as u8);
    if wide {
        share.extend([index, last]);
    } else {
        share.push(index << 4 | last);
    }
    put_number(packet.chunk, share);
    put_number(packet.others, share);
    let check = crc16(&[share, data]);
    share.extend(check.to_le_bytes());
    share.extend(data);
}

/// Reads a share. Returns its header and its data without padding.
pub fn read(share: &[u8]) -> Result<(Header, &[u8]), ModemError> {
    let cut = |needed| ModemError::Cut { found: share.len(), needed };
    let &[first, second, third, ref rest @ ..] = share else { return Err(cut(MIN_LEN)) };
    if first >> 6 != SHARE {
        return Err(ModemError::NotAFrame(first));
    }
    let wide = second & 8 != 0;
    let (index, last, mut rest) = match rest {
        [last, rest @ ..] if wide => (third, *last, rest),
        _ if wide => return Err(cut(MIN_LEN)),
        rest => (third >> 4, third & 0xF, rest),
    };
    let chunk = take_number(&mut rest).ok_or_else(|| cut(MIN_LEN))?;
    let others = take_number(&mut rest).ok_or_else(|| cut(MIN_LEN))?;
    let head = share.len() - rest.len();
    let &[low, high, ref data @ ..] = rest else { return Err(cut(MIN_LEN)) };
    let needed = head + 2 + chunk + others;
    let data = data.get(..chunk + others).ok_or_else(|| cut(needed))?;
    if crc16(&[&share[..head], data]) != u16::from_le_bytes([low, high]) {
        return Err(ModemError::ShareCheck);
    }
    let packet = PacketHeader {
        stream: first >> 4 & 3,
        number: u32::from(first & 0xF) << 4 | u32::from(second >> 4),
        count: usize::from(last) + 1,
        threshold: usize::from(second & 7) + 1,
        chunk,
        others,
    };
    let valid = index <= last && packet.threshold <= packet.count && chunk > 0;
    if !valid {
        return Err(ModemError::NotAFrame(first));
    }
    Ok((Header { packet, index: usize::from(index) }, data))
}

/// Fewest bytes of a protected share: a short header and one byte.
pub const MIN_LEN: usize = 8;

/// Longest number, bytes: 21 bits.
const NUMBER_LEN: usize = 3;

/// Bytes that a number takes.
pub fn number_len(number: usize) -> usize {
    match number {
        0..0x80 => 1,
        0x80..0x4000 => 2,
        _ => NUMBER_LEN,
    }
}

/// Appends a number below 2²¹.
pub fn put_number(mut number: usize, bytes: &mut Vec<u8>) {
    while number >= 0x80 {
        bytes.push(0x80 | (number & 0x7F) as u8);
        number >>= 7;
    }
    bytes.push(number as u8);
}

/// Takes a number from the start of some bytes; `None` if they end before it does, or it is too long.
pub fn take_number(bytes: &mut &[u8]) -> Option<usize> {
    let mut number = 0;
    for place in 0..NUMBER_LEN {
        let (byte, rest) = bytes.split_first()?;
        *bytes = rest;
        number |= usize::from(byte & 0x7F) << (7 * place);
        if byte & 0x80 == 0 {
            return Some(number);
        }
    }
    None
}
