//! Reading fields from bytes.

use super::{PacketError, Part};

/// CRC-16/IBM-3740: polynomial 0x1021, initial value 0xFFFF, nothing reflected.
const CRC16: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740);

/// The check of the parts of packets and of modem frames, over slices one after another.
pub fn crc16(slices: &[&[u8]]) -> u16 {
    let mut digest = CRC16.digest();
    slices.iter().for_each(|slice| digest.update(slice));
    digest.finalize()
}

/// Takes fields from the start of a part.
pub(super) struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    /// A reader of a part that takes `needed` bytes.
    pub(super) fn new(bytes: &'a [u8], part: Part, needed: usize) -> Result<Self, PacketError> {
        match bytes.get(..needed) {
            Some(bytes) => Ok(Reader { bytes, at: 0 }),
            None => Err(PacketError::TooShort { part, needed, found: bytes.len() }),
        }
    }

    /// The next `N` bytes.
    ///
    /// # Panics
    /// If the fields taken exceed the length given to [`Reader::new`].
    pub(super) fn take<const N: usize>(&mut self) -> [u8; N] {
        let field = std::array::from_fn(|i| self.bytes[self.at + i]);
        self.at += N;
        field
    }

    /// All bytes taken so far.
    pub(super) fn taken(&self) -> &'a [u8] {
        &self.bytes[..self.at]
    }
}

/// Low three bytes of a number.
pub(super) fn to_u24(value: u32) -> [u8; 3] {
    let [a, b, c, _] = value.to_le_bytes();
    [a, b, c]
}

/// The number of three bytes.
pub(super) fn from_u24([a, b, c]: [u8; 3]) -> u32 {
    u32::from_le_bytes([a, b, c, 0])
}
