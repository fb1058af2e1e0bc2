//! Little-endian numbers in a part.

use super::super::PriorError;

/// A part's content that is read from its start to its end.
pub struct Words<'a> {
    left: &'a [u8],
    /// Byte of the file at which what is left begins.
    at: usize,
}

impl<'a> Words<'a> {
    /// `at`: byte of the file at which the content begins.
    pub fn new(content: &'a [u8], at: usize) -> Words<'a> {
        Words { left: content, at }
    }

    /// Byte of the file of what is read next.
    pub fn at(&self) -> usize {
        self.at
    }

    /// The next bytes.
    pub fn take<const N: usize>(&mut self) -> Result<[u8; N], PriorError> {
        let truncated = PriorError::Truncated {
            needed: (self.at + N) as u128,
            found: self.at + self.left.len(),
        };
        let (taken, left) = self.left.split_first_chunk().ok_or(truncated)?;
        (self.left, self.at) = (left, self.at + N);
        Ok(*taken)
    }

    pub fn byte(&mut self) -> Result<u8, PriorError> {
        Ok(u8::from_le_bytes(self.take()?))
    }

    pub fn short(&mut self) -> Result<u16, PriorError> {
        Ok(u16::from_le_bytes(self.take()?))
    }

    pub fn word(&mut self) -> Result<u32, PriorError> {
        Ok(u32::from_le_bytes(self.take()?))
    }

    pub fn float(&mut self) -> Result<f32, PriorError> {
        Ok(f32::from_le_bytes(self.take()?))
    }

    pub fn double(&mut self) -> Result<f64, PriorError> {
        Ok(f64::from_le_bytes(self.take()?))
    }

    pub fn doubles<const N: usize>(&mut self) -> Result<[f64; N], PriorError> {
        let mut doubles = [0.0; N];
        doubles.iter_mut().try_for_each(|double| self.double().map(|value| *double = value))?;
        Ok(doubles)
    }

    pub fn floats<const N: usize>(&mut self) -> Result<[f32; N], PriorError> {
        let mut floats = [0.0; N];
        floats.iter_mut().try_for_each(|float| self.float().map(|value| *float = value))?;
        Ok(floats)
    }

    /// What follows.
    pub fn rest(self) -> &'a [u8] {
        self.left
    }

    /// Refuses bytes that were not read. `part`: what errors call it.
    pub fn end(self, part: &'static str) -> Result<(), PriorError> {
        match self.left.len() {
            0 => Ok(()),
            more => {
                let reason = format!("{more} bytes too many");
                Err(PriorError::Field { format: part, offset: self.at as u64, reason })
            }
        }
    }
}

/// A field at byte `offset` of the file that no writer leaves so.
pub fn refusal(part: &'static str, offset: usize, reason: impl ToString) -> PriorError {
    PriorError::Field { format: part, offset: offset as u64, reason: reason.to_string() }
}
