//! The compact prior, `.nvsg`: a file of about twelve bytes per splat, for both sides of a link.
//!
//! The bytes: `docs/format/prior.md`. Positions are off by up to half a step; rotations of key frames by up to 0.28°.
//! Key frames and preprocessing are no part of the identity; coder tables are. A reader that does not know a part
//! refuses the file.
//!
//! **Order.** Splats are in the order of the curve. The order is part of the prior's identity: the identity is the one
//! that [`write()`] returns, not that of the splats given to it. Splats close in space are also close in memory.
//!
//! **Same on every machine.** Reading uses only additions, products and square roots, and ends with a check of the
//! identity: a reader has the splats that the writer saw. Writing what was read, at the same quantisation, gives the
//! same splats again.
//!
//! **What it costs.** For the reef prior (39,713 splats of degree 1, 104 bytes each as PLY), with the default
//! quantisation and the same numbers in each stream; decoding on one core:
//!
//! | coder | bytes per splat | decoding, ms |
//! |---|---|---|
//! | deflate (flate2, level 9) | 13.19 | 8 |
//! | an adaptive range coder with contexts of neighbours | 12.23 | |
//! | Brotli (quality 11) | 12.02 | 18 |
//! | LZMA (lzma-rust2, preset 9) | 11.77 | 83 |
//!
//! Separate x, y and z take 0.3 bytes more than distances along the curve. Steps that shrink with
//! the size and opacity of a splat gave worse pictures at the same bytes than even steps.

mod coder_tables;
mod format;
mod header;
mod key_frames;
mod preprocessing;
mod quantise;
mod stream;

use std::io::Write;

use super::check::fault_of;
use super::identity::identity_of;
use super::{KeyFrames, PriorError, PriorFile, PriorFormat, PriorId, RenderOptions, Splats};
use crate::coder_tables::Tables;
use crate::image::Preprocessing;
use format::FORMAT;
pub use format::MAGIC;
use header::Header;
use quantise::{Grid, dequantise, quantise};
pub use quantise::{Quantisation, UNIFORM_BITS};

/// Bytes of the check at the end.
const CHECK: usize = 4;

/// Writes splats and key frames. Returns the identity of the prior that readers get; key frames are no part of it.
/// [`with_coder_tables`] adds coder tables, [`with_preprocessing`] a preprocessing.
///
/// Fails if the quantisation is out of its range, if a splat is invalid or one of its values too
/// large for its step, or if `writer` fails.
pub fn write(
    splats: &Splats,
    options: &RenderOptions,
    key_frames: &KeyFrames,
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
    let coded = Coded::of(splats, quantisation)?;
    let kept = coded.splats(splats.sh_degree, quantisation);
    let id = identity_of(&kept, options, None, None);
    let header = Header {
        sh_degree: splats.sh_degree,
        key_frames: !key_frames.is_empty(),
        coder_tables: false,
        preprocessing: false,
        count,
        id,
        options: *options,
        grid: coded.grid,
        quantisation: *quantisation,
    };
    let bytes = assembled(&header, &Preprocessing::NONE, key_frames, None, &coded.stream()?);
    writer.write_all(&bytes).and_then(|()| writer.flush()).map_err(PriorError::Write)?;
    Ok(id)
}

/// Replaces the key frames of a compact prior. All else stays, the identity too. Fails if `bytes` are no compact prior.
pub fn with_key_frames(bytes: &[u8], key_frames: &KeyFrames) -> Result<Vec<u8>, PriorError> {
    let parts = Parts::of(bytes)?;
    let header = Header { key_frames: !key_frames.is_empty(), ..parts.header };
    let (preprocessing, tables) = (&parts.preprocessing, parts.coder_tables.as_ref());
    Ok(assembled(&header, preprocessing, key_frames, tables, parts.stream))
}

/// Replaces or removes the coder tables of a compact prior. That makes it another prior. All else stays.
/// Fails if `bytes` are no compact prior.
pub fn with_coder_tables(bytes: &[u8], tables: Option<&Tables>) -> Result<Vec<u8>, PriorError> {
    let file = read(bytes)?;
    let parts = Parts::of(bytes)?;
    let id = identity_of(&file.splats, &file.options, tables, None);
    let header = Header { coder_tables: tables.is_some(), id, ..parts.header };
    Ok(assembled(&header, &parts.preprocessing, &parts.key_frames, tables, parts.stream))
}

/// States another preprocessing in a compact prior, or none. All else stays, the identity too. Fails if `bytes` are no
/// compact prior.
pub fn with_preprocessing(
    bytes: &[u8],
    preprocessing: &Preprocessing,
) -> Result<Vec<u8>, PriorError> {
    let parts = Parts::of(bytes)?;
    let header = Header { preprocessing: !preprocessing.is_none(), ..parts.header };
    let tables = parts.coder_tables.as_ref();
    Ok(assembled(&header, preprocessing, &parts.key_frames, tables, parts.stream))
}

fn assembled(
    header: &Header,
    preprocessing: &Preprocessing,
    key_frames: &KeyFrames,
    tables: Option<&Tables>,
    stream: &[u8],
) -> Vec<u8> {
    let mut bytes = header.to_bytes();
    bytes.extend(besides_to_bytes(preprocessing, key_frames, tables));
    bytes.extend(stream);
    bytes.extend(crc32fast::hash(&bytes).to_le_bytes());
    bytes
}

/// Reads the content of a compact prior. Memory depends on the content's size, whatever the header
/// says: at most 1000 bytes per byte, and a window of 64 MiB.
pub fn read(bytes: &[u8]) -> Result<PriorFile, PriorError> {
    let Parts { header, preprocessing, key_frames, coder_tables, stream_at, stream } =
        Parts::of(bytes)?;
    let count = header.count as usize;
    if count > stream.len() {
        let needed = (bytes.len() - stream.len()) as u128 + count as u128;
        return Err(PriorError::Truncated { needed, found: bytes.len() });
    }
    let unpacked = stream::unpack(stream, count, quantise::columns(header.sh_degree));
    let (ranks, columns) = unpacked.map_err(|e| PriorError::Field {
        format: FORMAT,
        offset: stream_at as u64,
        reason: format!("LZMA: {e}"),
    })?;
    let coded = Coded { grid: header.grid, ranks, columns };
    let splats = coded.splats(header.sh_degree, &header.quantisation);
    let found = identity_of(&splats, &header.options, coder_tables.as_ref(), None);
    if found != header.id {
        return Err(PriorError::Identity { stated: header.id, found });
    }
    Ok(PriorFile {
        splats,
        options: header.options,
        format: PriorFormat::Compact,
        comments: Vec::new(),
        key_frames,
        coder_tables,
        preprocessing,
        frame: None,
    })
}

/// The parts of a file, except the check.
struct Parts<'a> {
    header: Header,
    preprocessing: Preprocessing,
    key_frames: KeyFrames,
    coder_tables: Option<Tables>,
    /// Byte at which the coded part begins.
    stream_at: usize,
    stream: &'a [u8],
}

impl Parts<'_> {
    /// Checks a file's content, and reads all but the coded part.
    fn of(bytes: &[u8]) -> Result<Parts<'_>, PriorError> {
        if !bytes.starts_with(MAGIC) {
            return Err(PriorError::UnknownFormat);
        }
        let needed = (Header::BYTES + CHECK) as u128;
        let truncated = || PriorError::Truncated { needed, found: bytes.len() };
        let (content, check) = bytes.split_last_chunk::<CHECK>().ok_or_else(truncated)?;
        let rest = content.get(Header::BYTES..).ok_or_else(truncated)?;
        let (stated, found) = (u32::from_le_bytes(*check), crc32fast::hash(content));
        if stated != found {
            return Err(PriorError::Damaged { stated, found });
        }
        let header = Header::read(content)?;
        let there = [header.preprocessing, header.key_frames, header.coder_tables];
        let (besides, size) = read_besides(rest, Header::BYTES, there)?;
        let Besides { preprocessing, key_frames, coder_tables } = besides;
        let (stream_at, stream) = (Header::BYTES + size, &rest[size..]);
        Ok(Parts { header, preprocessing, key_frames, coder_tables, stream_at, stream })
    }
}

/// What a file holds besides splats.
pub(super) struct Besides {
    pub preprocessing: Preprocessing,
    pub key_frames: KeyFrames,
    pub coder_tables: Option<Tables>,
}

/// The bytes of what a file holds besides splats. Of what is not there it holds none.
pub(super) fn besides_to_bytes(
    preprocessing: &Preprocessing,
    key_frames: &KeyFrames,
    tables: Option<&Tables>,
) -> Vec<u8> {
    let mut bytes = preprocessing::to_bytes(preprocessing);
    bytes.extend(key_frames::to_bytes(key_frames));
    bytes.extend(coder_tables::to_bytes(tables));
    bytes
}

/// Reads what [`besides_to_bytes`] wrote, from the start of `bytes`, which begin at byte `at` of the file. `there`:
/// whether it holds a preprocessing, key frames, coder tables. Also returns how many bytes they take.
pub(super) fn read_besides(
    bytes: &[u8],
    at: usize,
    there: [bool; 3],
) -> Result<(Besides, usize), PriorError> {
    let mut besides = Besides {
        preprocessing: Preprocessing::NONE,
        key_frames: KeyFrames::NONE,
        coder_tables: None,
    };
    let mut size = 0;
    if there[0] {
        besides.preprocessing = preprocessing::read(bytes, at)?;
        size += preprocessing::BYTES;
    }
    if there[1] {
        let (frames, own) = key_frames::read(&bytes[size..], at + size)?;
        besides.key_frames = frames;
        size += own;
    }
    if there[2] {
        let (tables, own) = coder_tables::read(&bytes[size..], at + size)?;
        besides.coder_tables = Some(tables);
        size += own;
    }
    Ok((besides, size))
}

/// Splats in steps, in the order of the file.
struct Coded {
    grid: Grid,
    ranks: Vec<u128>,
    columns: Vec<Vec<i32>>,
}

impl Coded {
    /// Splats in steps and in order; those at one place keep theirs.
    fn of(splats: &Splats, quantisation: &Quantisation) -> Result<Coded, PriorError> {
        let faults = (0..splats.len()).map(|splat| (splat, fault_of(splats, splat)));
        for (splat, fault) in faults {
            fault.map_or(Ok(()), |fault| Err(PriorError::Invalid { splat, fault }))?;
        }
        let grid = Grid::of(&splats.positions, quantisation.position);
        let rows = (0..splats.len()).map(|i| quantise(splats, i, quantisation));
        let rows = rows.collect::<Result<Vec<_>, _>>()?;
        let ranks = splats.positions.iter().map(|p| stream::rank(grid.code(*p)));
        let mut order: Vec<(u128, usize)> = ranks.zip(0..).collect();
        order.sort_unstable();
        let columns = vec![vec![0; splats.len()]; quantise::columns(splats.sh_degree)];
        let mut coded = Coded { grid, ranks: vec![0; splats.len()], columns };
        for (place, (rank, index)) in order.into_iter().enumerate() {
            let position = grid.position(stream::unrank(rank));
            if let Some(axis) = position.iter().position(|v| !v.is_finite()) {
                return Err(PriorError::OutOfSteps {
                    splat: index,
                    column: "position",
                    value: splats.positions[index][axis],
                    step: quantisation.position,
                });
            }
            coded.ranks[place] = rank;
            for (column, code) in coded.columns.iter_mut().zip(&rows[index]) {
                column[place] = *code;
            }
        }
        Ok(coded)
    }

    /// The coded part of a file: at least one byte per splat, so that a reader can trust the count.
    fn stream(&self) -> Result<Vec<u8>, PriorError> {
        let mut bytes = stream::pack(&self.ranks, &self.columns).map_err(PriorError::Write)?;
        bytes.resize(bytes.len().max(self.ranks.len()), 0);
        Ok(bytes)
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
