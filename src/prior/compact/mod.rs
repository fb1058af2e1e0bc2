//! The compact prior, `.nvsg`: a file of a few bytes a splat.
//!
//! TODO

mod coder;
mod header;
mod number;
mod orientation;
mod quantise;
mod stream;

use std::io::Write;

use super::check::fault_of;
use super::{PriorError, PriorFile, PriorFormat, PriorId, RenderOptions, Splats};
use coder::{Reader, Writer};
use header::Header;
use quantise::{Grid, dequantise, quantise};
pub use quantise::{Quantisation, UNIFORM_BITS};

/// How a compact prior starts.
pub const MAGIC: &[u8] = b"nvsg";

/// Bytes of the check at the end.
const CHECK: usize = 4;

/// Writes splats; returns the identity of the prior that readers get.
///
/// Fails where the quantisation is out of its range, where a splat is unsound or one of its values
/// too large for its step, and where `writer` does.
pub fn write(
    splats: &Splats,
    options: &RenderOptions,
    quantisation: &Quantisation,
    mut writer: impl Write,
) -> Result<PriorId, PriorError> {
    quantisation.check()?;
    options.check()?;
    splats.check_shape()?;
    if splats.is_empty() {
        return Err(PriorError::Empty);
    }
    let count =
        u32::try_from(splats.len()).map_err(|_| PriorError::TooMany { count: splats.len() })?;
    let mut coded = Coded::of(splats, quantisation)?;
    let kept = coded.splats(splats.sh_degree, quantisation);
    let id = PriorId::of(&kept, options);
    let header = Header {
        sh_degree: splats.sh_degree,
        count,
        id,
        options: *options,
        grid: coded.grid,
        quantisation: *quantisation,
    };
    let mut bytes = header.to_bytes();
    bytes.extend(coded.stream());
    bytes.extend(crc32fast::hash(&bytes).to_le_bytes());
    writer.write_all(&bytes).and_then(|()| writer.flush()).map_err(PriorError::Write)?;
    Ok(id)
}

/// Reads the content of a compact prior. Memory grows with the content's size, whatever the header
/// says: at most 500 bytes for each byte.
pub fn read(bytes: &[u8]) -> Result<PriorFile, PriorError> {
    if !bytes.starts_with(MAGIC) {
        return Err(PriorError::UnknownFormat);
    }
    let (content, stream) = split(bytes)?;
    let header = Header::read(content)?;
    let count = header.count as usize;
    if count > stream.len() {
        let needed = (bytes.len() - stream.len()) as u128 + count as u128;
        return Err(PriorError::Truncated { needed, found: bytes.len() });
    }
    let mut coded = Coded::empty(header.grid, count, header.sh_degree);
    let mut reader = Reader::new(stream);
    coded.code(&mut reader);
    if reader.taken() > stream.len() {
        return Err(PriorError::Truncated {
            needed: (bytes.len() - stream.len() + reader.taken()) as u128,
            found: bytes.len(),
        });
    }
    let splats = coded.splats(header.sh_degree, &header.quantisation);
    let found = PriorId::of(&splats, &header.options);
    if found != header.id {
        return Err(PriorError::Identity { stated: header.id, found });
    }
    let (options, format) = (header.options, PriorFormat::Compact);
    Ok(PriorFile { splats, options, format, comments: Vec::new() })
}

/// Checks the content; gives it without the check, and its coded part.
fn split(bytes: &[u8]) -> Result<(&[u8], &[u8]), PriorError> {
    let truncated =
        || PriorError::Truncated { needed: (Header::BYTES + CHECK) as u128, found: bytes.len() };
    let (content, check) = bytes.split_last_chunk::<CHECK>().ok_or_else(truncated)?;
    let stream = content.get(Header::BYTES..).ok_or_else(truncated)?;
    let (stated, found) = (u32::from_le_bytes(*check), crc32fast::hash(content));
    match stated == found {
        true => Ok((content, stream)),
        false => Err(PriorError::Damaged { stated, found }),
    }
}

/// Splats in steps, in the order of the file.
struct Coded {
    grid: Grid,
    ranks: Vec<u128>,
    columns: Vec<Vec<i32>>,
}

impl Coded {
    /// Zeros, for a reader to fill.
    fn empty(grid: Grid, count: usize, sh_degree: u32) -> Coded {
        let columns = vec![vec![0; count]; quantise::columns(sh_degree)];
        Coded { grid, ranks: vec![0; count], columns }
    }

    /// Splats in steps and in order; those at one place keep theirs.
    fn of(splats: &Splats, quantisation: &Quantisation) -> Result<Coded, PriorError> {
        let faults = (0..splats.len()).map(|splat| (splat, fault_of(splats, splat)));
        for (splat, fault) in faults {
            fault.map_or(Ok(()), |fault| Err(PriorError::Unsound { splat, fault }))?;
        }
        let grid = Grid::of(&splats.positions, quantisation.position);
        let rows = (0..splats.len()).map(|i| quantise(splats, i, quantisation));
        let rows = rows.collect::<Result<Vec<_>, _>>()?;
        let ranks = splats.positions.iter().map(|p| stream::rank(grid.code(*p)));
        let mut order: Vec<(u128, usize)> = ranks.zip(0..).collect();
        order.sort_unstable();
        let mut coded = Coded::empty(grid, splats.len(), splats.sh_degree);
        for (place, (rank, index)) in order.into_iter().enumerate() {
            let position = grid.position(stream::unrank(rank));
            if !position.iter().all(|v| v.is_finite()) {
                let [value, ..] = splats.positions[index];
                let step = quantisation.position;
                let column = "position";
                return Err(PriorError::OutOfSteps { splat: index, column, value, step });
            }
            coded.ranks[place] = rank;
            for (column, code) in coded.columns.iter_mut().zip(&rows[index]) {
                column[place] = *code;
            }
        }
        Ok(coded)
    }

    /// Codes all numbers, with either side of the coder.
    fn code(&mut self, coder: &mut impl coder::Coder) {
        stream::code_ranks(coder, &mut self.ranks);
        stream::code_columns(coder, &mut self.columns);
    }

    /// The coded part of a file: at least a byte a splat, so that a reader can trust the count.
    fn stream(&mut self) -> Vec<u8> {
        let mut writer = Writer::new();
        self.code(&mut writer);
        let mut bytes = writer.finish();
        bytes.resize(bytes.len().max(self.ranks.len()), 0);
        bytes
    }

    /// The splats that the numbers stand for.
    fn splats(&self, sh_degree: u32, quantisation: &Quantisation) -> Splats {
        let mut splats = Splats::with_capacity(self.ranks.len(), sh_degree);
        let mut row = vec![0; self.columns.len()];
        for (place, rank) in self.ranks.iter().enumerate() {
            for (code, column) in row.iter_mut().zip(&self.columns) {
                *code = column[place];
            }
            let position = self.grid.position(stream::unrank(*rank));
            dequantise(&mut splats, position, &row, quantisation);
        }
        splats
    }
}

#[cfg(test)]
mod tests;
