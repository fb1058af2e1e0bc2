//! The blocks of a scan, read without making anything of them.

use super::bits::{Bits, Huffman};
use super::error::JpegError;

/// Blocks have 8×8 pixels.
pub const SIDE: usize = 8;
/// Coefficients of a block.
const COUNT: usize = 64;
/// Nothing of a coefficient has come.
const NONE: u8 = u8::MAX;

/// What has come of a component's coefficients.
pub struct Coefficients {
    /// By block, if the picture is progressive: those that are not 0.
    nonzero: Vec<u64>,
    /// The lowest bit that has come of each.
    low: [u8; COUNT],
}

impl Coefficients {
    pub fn new(blocks: usize) -> Coefficients {
        Coefficients { nonzero: vec![0; blocks], low: [NONE; COUNT] }
    }

    pub fn is_whole(&self) -> bool {
        self.low == [0; COUNT]
    }
}

/// What a scan header says.
pub struct Scan<'a> {
    pub progressive: bool,
    /// First and last coefficient.
    pub band: (usize, usize),
    /// Bit that came before, and bit that comes now.
    pub bits: (u8, u8),
    /// Units between two restart marks; 0: there are none.
    pub restart: usize,
    /// Units in columns and rows.
    pub units: (usize, usize),
    pub parts: Vec<Part<'a>>,
}

/// A component in a scan.
pub struct Part<'a> {
    /// Its blocks in a unit.
    pub unit: (usize, usize),
    /// Its blocks in a row, filling included.
    pub row: usize,
    pub coefficients: &'a mut Coefficients,
    pub dc: Huffman,
    pub ac: Huffman,
}

impl Scan<'_> {
    /// Reads all, and gives the place behind it.
    pub fn read(mut self, bytes: &[u8], at: usize) -> Result<usize, JpegError> {
        let mut bits = Bits::new(bytes, at);
        let mut run = 0;
        let (columns, rows) = self.units;
        for unit in 0..columns * rows {
            if self.restart > 0 && unit > 0 && unit % self.restart == 0 {
                bits.restart(unit / self.restart - 1)?;
                run = 0;
            }
            let (x, y) = (unit % columns, unit / columns);
            for part in &mut self.parts {
                let (wide, high) = part.unit;
                for block in 0..wide * high {
                    let (x, y) = (x * wide + block % wide, y * high + block / wide);
                    let place = y * part.row + x;
                    part.block(
                        &mut bits,
                        self.progressive,
                        (self.band, self.bits),
                        place,
                        &mut run,
                    )?;
                }
            }
        }
        bits.end()?;
        let (band, low) = match self.progressive {
            true => (self.band.0..=self.band.1, self.bits.1),
            false => (0..=COUNT - 1, 0),
        };
        for part in self.parts {
            part.coefficients.low[band.clone()].fill(low);
        }
        Ok(bits.at)
    }
}

impl Part<'_> {
    /// Blocks of a component that is alone in its scan, in columns and rows: those that the picture touches.
    pub fn blocks(
        size: (usize, usize),
        sampling: (usize, usize),
        largest: (usize, usize),
    ) -> (usize, usize) {
        let along =
            |size: usize, own: usize, most: usize| (size * own).div_ceil(most).div_ceil(SIDE);
        (along(size.0, sampling.0, largest.0), along(size.1, sampling.1, largest.1))
    }

    /// `run`: blocks that follow without coefficients of the band.
    fn block(
        &mut self,
        bits: &mut Bits<'_>,
        progressive: bool,
        ((first, last), (before, _)): ((usize, usize), (u8, u8)),
        place: usize,
        run: &mut u32,
    ) -> Result<(), JpegError> {
        if !progressive {
            self.dc(bits)?;
            return self.ac(bits, (1, COUNT - 1), &mut 0, &mut 0);
        }
        let mut own = self.coefficients.nonzero.get(place).copied().unwrap_or_default();
        match (first, before) {
            (0, 0) => self.dc(bits)?,
            (0, _) => drop(bits.bit()?),
            (_, 0) => self.ac(bits, (first, last), &mut own, run)?,
            _ => self.refine(bits, (first, last), &mut own, run)?,
        }
        if let Some(nonzero) = self.coefficients.nonzero.get_mut(place) {
            *nonzero = own;
        }
        Ok(())
    }

    fn dc(&self, bits: &mut Bits<'_>) -> Result<(), JpegError> {
        let length = self.dc.decode(bits)?;
        if length > 16 {
            return Err(bits.broken("a coefficient of more than 16 bits"));
        }
        bits.number(length.into()).map(drop)
    }

    fn ac(
        &self,
        bits: &mut Bits<'_>,
        (first, last): (usize, usize),
        nonzero: &mut u64,
        run: &mut u32,
    ) -> Result<(), JpegError> {
        let mut at = first;
        while *run == 0 && at <= last {
            match self.code(bits)? {
                (15, 0) => at += 16,
                (zeros, 0) => *run = run_of_blocks(bits, zeros)?,
                (zeros, length) => {
                    at += zeros as usize;
                    if at > last {
                        return Err(bits.broken("a block of more than 64 coefficients"));
                    }
                    bits.number(length)?;
                    *nonzero |= 1 << at;
                    at += 1;
                }
            }
        }
        *run = run.saturating_sub(1);
        Ok(())
    }

    /// Zeros before a coefficient, and how many bits it has.
    fn code(&self, bits: &mut Bits<'_>) -> Result<(u32, u32), JpegError> {
        let code = self.ac.decode(bits)?;
        Ok((u32::from(code >> 4), u32::from(code & 15)))
    }

    /// One bit more of coefficients: those that are there have one each, between the others' codes.
    fn refine(
        &self,
        bits: &mut Bits<'_>,
        (first, last): (usize, usize),
        nonzero: &mut u64,
        run: &mut u32,
    ) -> Result<(), JpegError> {
        let mut at = first;
        while *run == 0 && at <= last {
            let (mut zeros, length) = self.code(bits)?;
            let is_new = length > 0;
            if zeros < 15 && !is_new {
                *run = run_of_blocks(bits, zeros)?;
                break;
            }
            if is_new {
                bits.bit()?;
            }
            while at <= last {
                let is_there = *nonzero >> at & 1 == 1;
                at += 1;
                if is_there {
                    bits.bit()?;
                } else if zeros == 0 {
                    *nonzero |= u64::from(is_new) << (at - 1);
                    break;
                } else {
                    zeros -= 1;
                }
            }
        }
        if *run > 0 {
            let there = (at..=last).filter(|at| *nonzero >> at & 1 == 1).count();
            bits.number(there as u32)?;
            *run -= 1;
        }
        Ok(())
    }
}

/// Blocks without more coefficients of the band, this one counted. The code's bits, and then as many more.
fn run_of_blocks(bits: &mut Bits<'_>, length: u32) -> Result<u32, JpegError> {
    Ok((1 << length) + bits.number(length)?)
}
