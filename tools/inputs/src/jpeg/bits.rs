//! The bits of a scan, and their Huffman codes.

use super::error::JpegError;

const EOI: u8 = 0xD9;

pub struct Bits<'a> {
    bytes: &'a [u8],
    /// The next byte.
    pub at: usize,
    byte: u8,
    left: u32,
}

impl<'a> Bits<'a> {
    pub fn new(bytes: &'a [u8], at: usize) -> Bits<'a> {
        Bits { bytes, at, byte: 0, left: 0 }
    }

    pub fn broken(&self, what: &'static str) -> JpegError {
        JpegError::Broken { at: self.at, what }
    }

    pub fn bit(&mut self) -> Result<u32, JpegError> {
        if self.left == 0 {
            let cut = JpegError::Cut { at: self.at };
            self.byte = *self.bytes.get(self.at).ok_or(cut.clone())?;
            self.at += 1;
            if self.byte == 0xFF {
                match self.bytes.get(self.at) {
                    Some(0) => self.at += 1,
                    Some(&EOI) | None => return Err(cut),
                    Some(_) => return Err(self.broken("a scan ends before its last block")),
                }
            }
            self.left = 8;
        }
        self.left -= 1;
        Ok(u32::from(self.byte >> self.left) & 1)
    }

    pub fn number(&mut self, bits: u32) -> Result<u32, JpegError> {
        (0..bits).try_fold(0, |number, _| Ok(number << 1 | self.bit()?))
    }

    /// Goes on behind a restart mark of this number.
    pub fn restart(&mut self, number: usize) -> Result<(), JpegError> {
        self.end()?;
        let mark = 0xD0 | (number % 8) as u8;
        match self.bytes.get(self.at..self.at + 2) {
            Some(found) if found == [0xFF, mark] => self.at += 2,
            _ => return Err(self.broken("a restart mark is missing")),
        }
        Ok(())
    }

    /// Goes to the next mark. Nothing but filling may lie before it.
    pub fn end(&mut self) -> Result<(), JpegError> {
        self.left = 0;
        loop {
            match self.bytes.get(self.at..) {
                None | Some([]) => return Ok(()),
                Some([0xFF, 0xFF, ..] | [0, ..] | [0xFF]) => self.at += 1,
                Some([0xFF, 0, ..]) => self.at += 2,
                Some([0xFF, ..]) => return Ok(()),
                Some(_) => return Err(self.broken("data are left over behind a scan's last block")),
            }
        }
    }
}

/// A table of codes, by their lengths.
#[derive(Clone, Default)]
pub struct Huffman {
    values: Vec<u8>,
    /// By length − 1: the first code, how many there are, and the place of the first one's value.
    lengths: [(u32, u32, usize); 16],
}

impl Huffman {
    /// `counts`: of codes of 1 to 16 bits.
    pub fn new(counts: &[u8], values: &[u8]) -> Huffman {
        let mut table = Huffman { values: values.to_vec(), ..Huffman::default() };
        let (mut code, mut place) = (0, 0);
        for (length, count) in table.lengths.iter_mut().zip(counts) {
            *length = (code, u32::from(*count), place);
            code = (code + u32::from(*count)) << 1;
            place += usize::from(*count);
        }
        table
    }

    pub fn decode(&self, bits: &mut Bits<'_>) -> Result<u8, JpegError> {
        let mut code = 0;
        for (first, count, place) in self.lengths {
            code = code << 1 | bits.bit()?;
            if code.wrapping_sub(first) < count {
                let value = self.values.get(place + (code - first) as usize);
                return value.copied().ok_or_else(|| bits.broken("its Huffman table"));
            }
        }
        Err(bits.broken("a code that its Huffman table does not have"))
    }
}
