//! The residual part: a coded difference picture, or why there is none.

use super::bytes::Reader;
use super::{PacketError, Part};

/// Longest payload, bytes: four groups of seven bits.
pub(super) const MAX_PAYLOAD: usize = (1 << 28) - 1;
/// Bytes of the CRC-32.
const CHECK_LEN: usize = 4;

const CODE_NONE: u8 = 0;
const CODE_OMITTED: u8 = 1;

/// How a difference picture is coded; the number is the code in a packet's flags.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Coder {
    /// A VP8 key frame without what the packet's header says already.
    Vp8 = 2,
    /// A whole WebP file.
    WebP = 3,
}

/// The difference picture of a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Residual<'a> {
    /// None was asked for, or the render alone was good enough.
    None,
    /// One was asked for, but the byte budget could not hold any.
    Omitted,
    /// A coded difference picture.
    Coded {
        /// How it is coded.
        coder: Coder,
        /// Its bytes.
        payload: &'a [u8],
    },
}

/// The start of a coded difference picture whose end is missing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ResidualStart<'a> {
    /// How it is coded.
    pub coder: Coder,
    /// Its first bytes. No check covers them.
    pub payload: &'a [u8],
    /// How many bytes it has in all.
    pub payload_len: usize,
}

/// Length of the residual part that holds a payload of this length, bytes.
pub fn residual_part_len(payload: usize) -> usize {
    length_field(payload).count() + payload + CHECK_LEN
}

/// What the flags say about a residual.
pub(super) fn code_of(residual: &Residual) -> u8 {
    match residual {
        Residual::None => CODE_NONE,
        Residual::Omitted => CODE_OMITTED,
        Residual::Coded { coder, .. } => *coder as u8,
    }
}

/// Appends the part to a packet that begins with `latent_len` bytes of latent part.
pub(super) fn write(
    payload: &[u8],
    latent_len: usize,
    packet: &mut Vec<u8>,
) -> Result<(), PacketError> {
    if payload.len() > MAX_PAYLOAD {
        return Err(PacketError::PayloadLength);
    }
    let start = packet.len();
    packet.extend(length_field(payload.len()));
    packet.extend_from_slice(payload);
    let check = check(&packet[..latent_len], &packet[start..]);
    packet.extend_from_slice(&check.to_le_bytes());
    Ok(())
}

/// The residual, and where only its end is missing its start.
pub(super) fn decode<'a>(
    code: u8,
    bytes: &'a [u8],
    latent: &[u8],
) -> (Result<Residual<'a>, PacketError>, Option<ResidualStart<'a>>) {
    let (coder, length, field) = match read_head(code, bytes) {
        Ok(Head::Coded { coder, length, field }) => (coder, length, field),
        Ok(Head::Uncoded(residual)) => return (Ok(residual), None),
        Err(error) => return (Err(error), None),
    };
    let needed = field + length + CHECK_LEN;
    let Some(part) = bytes.get(..needed) else {
        let payload = &bytes[field..bytes.len().min(field + length)];
        let start = ResidualStart { coder, payload, payload_len: length };
        let error = PacketError::TooShort { part: Part::Residual, needed, found: bytes.len() };
        return (Err(error), Some(start));
    };
    let (checked, found) = part.split_at(field + length);
    let residual = if check(latent, checked).to_le_bytes() == found {
        Ok(Residual::Coded { coder, payload: &checked[field..] })
    } else {
        Err(PacketError::Check(Part::Residual))
    };
    (residual, None)
}

/// What flags and length field say.
enum Head {
    Uncoded(Residual<'static>),
    Coded { coder: Coder, length: usize, field: usize },
}

fn read_head(code: u8, bytes: &[u8]) -> Result<Head, PacketError> {
    let coder = match code {
        CODE_NONE => return Ok(Head::Uncoded(Residual::None)),
        CODE_OMITTED => return Ok(Head::Uncoded(Residual::Omitted)),
        code if code == Coder::Vp8 as u8 => Coder::Vp8,
        code if code == Coder::WebP as u8 => Coder::WebP,
        code => return Err(PacketError::Coder(code)),
    };
    let (length, field) = read_length(bytes)?;
    Ok(Head::Coded { coder, length, field })
}

fn check(latent: &[u8], part: &[u8]) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(latent);
    hasher.update(part);
    hasher.finalize()
}

/// The length as the part starts with it: seven bits a byte, low bits first.
fn length_field(length: usize) -> impl Iterator<Item = u8> {
    let groups = std::iter::successors(Some(length), |rest| Some(rest >> 7).filter(|r| *r > 0));
    groups.map(|rest| (rest & 0x7F) as u8 | if rest >> 7 > 0 { 0x80 } else { 0 })
}

/// The payload's length, and how many bytes say so.
fn read_length(bytes: &[u8]) -> Result<(usize, usize), PacketError> {
    let mut length = 0;
    for index in 0..4 {
        let [byte] = Reader::new(bytes.get(index..).unwrap_or(&[]), Part::Residual, 1)?.take();
        length |= usize::from(byte & 0x7F) << (7 * index);
        if byte & 0x80 == 0 {
            return Ok((length, index + 1));
        }
    }
    Err(PacketError::PayloadLength)
}
