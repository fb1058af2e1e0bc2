//! Whether a JPEG is whole.
//!
//! Decoders fill what is missing of one with grey, and say nothing. So its Huffman codes are read here as ITU-T T.81
//! has them, without making a picture of them: each scan must have the blocks that the frame header promises, and end
//! with them. A progressive one must have all bits of all coefficients. Baseline, extended and progressive pictures are
//! known; others are left to the decoder.

mod bits;
mod error;
mod scan;

use bits::Huffman;
pub use error::JpegError;
use scan::{Coefficients, Part, SIDE, Scan};

/// A component of the picture.
struct Component {
    id: u8,
    /// Sampling, horizontal and vertical: its blocks in a unit of an interleaved scan.
    sampling: (usize, usize),
    coefficients: Coefficients,
}

/// What the headers before a scan have said.
#[derive(Default)]
struct Headers {
    components: Vec<Component>,
    size: (usize, usize),
    progressive: bool,
    dc: [Option<Huffman>; 4],
    ac: [Option<Huffman>; 4],
    restart: usize,
}

const SOF0: u8 = 0xC0;
const SOF2: u8 = 0xC2;
const DHT: u8 = 0xC4;
const SOI: u8 = 0xD8;
const EOI: u8 = 0xD9;
const SOS: u8 = 0xDA;
const DRI: u8 = 0xDD;

/// Reads all of a JPEG. A missing end mark alone is no fault.
pub fn check(bytes: &[u8]) -> Result<(), JpegError> {
    let (mut headers, mut at) = (Headers::default(), 0);
    while let Some((marker, after)) = next_marker(bytes, at) {
        at = after;
        match marker {
            EOI => break,
            SOI | 0x01 | 0xD0..=0xD7 => continue,
            _ => {}
        }
        let segment = segment(bytes, at)?;
        at += 2 + segment.len();
        let broken = |what| JpegError::Broken { at, what };
        match marker {
            SOF0..=SOF2 => {
                headers.frame(segment, marker == SOF2).ok_or(broken("its frame header"))?;
                // Each block takes a bit at least.
                let room = headers.make_room(bytes.len().saturating_mul(8));
                room.ok_or(JpegError::Cut { at: bytes.len() })?;
            }
            // Lossless and arithmetic ones, which the decoder refuses by name.
            0xC3 | 0xC5..=0xC7 | 0xC9..=0xCB | 0xCD..=0xCF => return Ok(()),
            DHT => headers.tables(segment).ok_or(broken("its Huffman tables"))?,
            DRI => headers.restart = segment.get(..2).map_or(0, number),
            SOS => at = headers.scan(segment, bytes, at)?,
            _ => {}
        }
    }
    headers.check_whole(bytes.len())
}

/// The next marker at or after a place, and the place behind it.
fn next_marker(bytes: &[u8], from: usize) -> Option<(u8, usize)> {
    let pairs = bytes.get(from..)?.windows(2);
    let at = pairs.into_iter().position(|pair| pair[0] == 0xFF && !matches!(pair[1], 0 | 0xFF))?;
    Some((bytes[from + at + 1], from + at + 2))
}

fn number(two: &[u8]) -> usize {
    usize::from(two[0]) << 8 | usize::from(two[1])
}

/// What a segment holds behind its length.
fn segment(bytes: &[u8], at: usize) -> Result<&[u8], JpegError> {
    let cut = JpegError::Cut { at: bytes.len() };
    let length = bytes.get(at..at + 2).map(number).ok_or(cut.clone())?;
    if length < 2 {
        return Err(JpegError::Broken { at, what: "a segment without length" });
    }
    bytes.get(at + 2..at + length).ok_or(cut)
}

impl Headers {
    fn frame(&mut self, segment: &[u8], progressive: bool) -> Option<()> {
        self.size = (segment.get(3..5).map(number)?, segment.get(1..3).map(number)?);
        self.progressive = progressive;
        let count = usize::from(*segment.get(5)?);
        let listed = segment.get(6..6 + 3 * count)?.chunks_exact(3);
        let sampling = |byte: u8| (usize::from(byte >> 4), usize::from(byte & 15));
        let listed: Vec<_> = listed.map(|entry| (entry[0], sampling(entry[1]))).collect();
        let valid = |(_, (h, v)): &(u8, (usize, usize))| (1..=4).contains(h) && (1..=4).contains(v);
        if listed.is_empty() || !listed.iter().all(valid) || self.size.0 == 0 || self.size.1 == 0 {
            return None;
        }
        let component =
            |(id, sampling)| Component { id, sampling, coefficients: Coefficients::new(0) };
        self.components = listed.into_iter().map(component).collect();
        Some(())
    }

    /// For what is to be remembered of each block, if there are at most so many.
    fn make_room(&mut self, most: usize) -> Option<()> {
        let units = self.units();
        let blocks = |c: &Component| units.0 * units.1 * c.sampling.0 * c.sampling.1;
        let all: usize = self.components.iter().map(blocks).sum();
        for component in self.components.iter_mut().filter(|_| self.progressive && all <= most) {
            component.coefficients = Coefficients::new(blocks(component));
        }
        (all <= most).then_some(())
    }

    /// The greatest sampling.
    fn largest(&self) -> (usize, usize) {
        let most = |of: fn((usize, usize)) -> usize| {
            self.components.iter().map(|component| of(component.sampling)).max().unwrap_or(1)
        };
        (most(|s| s.0), most(|s| s.1))
    }

    /// Units of an interleaved scan, in columns and rows.
    fn units(&self) -> (usize, usize) {
        let (h, v) = self.largest();
        (self.size.0.div_ceil(SIDE * h), self.size.1.div_ceil(SIDE * v))
    }

    fn tables(&mut self, mut segment: &[u8]) -> Option<()> {
        while let Some((&first, rest)) = segment.split_first() {
            let counts = rest.get(..16)?;
            let all: usize = counts.iter().map(|count| usize::from(*count)).sum();
            let values = rest.get(16..16 + all)?;
            let tables = if first >> 4 == 0 { &mut self.dc } else { &mut self.ac };
            *tables.get_mut(usize::from(first & 15))? = Some(Huffman::new(counts, values));
            segment = &rest[16 + all..];
        }
        Some(())
    }

    /// Reads a scan's data, and gives the place behind them.
    fn scan(&mut self, segment: &[u8], bytes: &[u8], at: usize) -> Result<usize, JpegError> {
        let broken = JpegError::Broken { at, what: "its scan header" };
        let (largest, units) = (self.largest(), self.units());
        let count = usize::from(*segment.first().ok_or(broken.clone())?);
        let rest = segment.get(1 + 2 * count..4 + 2 * count).ok_or(broken.clone())?;
        let (band, bits) = ((rest[0].into(), rest[1].into()), (rest[2] >> 4, rest[2] & 15));
        let is_band = band.0 <= band.1 && band.1 < SIDE * SIDE && (band.0 > 0 || band.1 == 0);
        // Only the first coefficients of several components may be interleaved.
        let is_valid = !self.progressive || is_band && (count == 1 || band.0 == 0);
        if !is_valid || !(1..=4).contains(&count) {
            return Err(broken);
        }
        let (progressive, restart) = (self.progressive, self.restart);
        let mut scan = Scan { progressive, band, bits, restart, units, parts: Vec::new() };
        let table = |tables: &[Option<Huffman>; 4], which: u8| {
            tables.get(usize::from(which)).cloned().flatten().unwrap_or_default()
        };
        let mut components: Vec<_> = self.components.iter_mut().map(Some).collect();
        for entry in segment[1..1 + 2 * count].chunks_exact(2) {
            let own =
                |c: &&mut Option<&mut Component>| c.as_ref().is_some_and(|c| c.id == entry[0]);
            let component = components.iter_mut().find(own).and_then(Option::take);
            let Component { sampling, coefficients, .. } = component.ok_or(broken.clone())?;
            let row = units.0 * sampling.0;
            let (dc, ac) = (table(&self.dc, entry[1] >> 4), table(&self.ac, entry[1] & 15));
            scan.parts.push(Part { unit: *sampling, row, coefficients, dc, ac });
        }
        if let [part] = &mut scan.parts[..] {
            scan.units = Part::blocks(self.size, part.unit, largest);
            part.unit = (1, 1);
        }
        scan.read(bytes, at)
    }

    /// Whether all that makes a picture has come.
    fn check_whole(&self, end: usize) -> Result<(), JpegError> {
        if self.components.is_empty() {
            return Err(JpegError::Cut { at: end });
        }
        match self.components.iter().all(|component| component.coefficients.is_whole()) {
            true => Ok(()),
            false => Err(JpegError::Scans),
        }
    }
}

#[cfg(test)]
mod tests;
