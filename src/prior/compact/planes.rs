//! Byte planes as one LZMA stream.

use std::io::{Read, Result, Write};

use lzma_rust2::{LzmaOptions, LzmaReader, LzmaWriter};

use super::super::PriorError;

/// Largest window of the coder, bytes; smaller if there is less to code.
const WINDOW: usize = 1 << 26;

fn window(size: usize) -> u32 {
    size.clamp(1 << 12, WINDOW) as u32
}

/// Codes the planes of `count` splats. They come to at least one byte per splat, so that a reader can trust the count.
pub fn pack(planes: &[u8], count: usize) -> Result<Vec<u8>> {
    let mut options = LzmaOptions::with_preset(9);
    (options.lc, options.lp, options.pb) = (0, 0, 0);
    options.dict_size = window(planes.len());
    let mut writer = LzmaWriter::new_no_header(Vec::new(), &options, false)?;
    writer.write_all(planes)?;
    let mut bytes = writer.finish()?;
    bytes.resize(bytes.len().max(count), 0);
    Ok(bytes)
}

/// Reads planes of so many splats, of so many bytes. `bytes` begin at byte `at` of a file; `part`: what errors call it.
pub fn unpack(
    bytes: &[u8],
    at: usize,
    part: &'static str,
    (count, size): (usize, usize),
) -> std::result::Result<Vec<u8>, PriorError> {
    if count > bytes.len() {
        let (needed, found) = (at as u128 + count as u128, at + bytes.len());
        return Err(PriorError::Truncated { needed, found });
    }
    let read = || {
        let mut reader = LzmaReader::new(bytes, size as u64, 0, 0, 0, window(size), None)?;
        let mut planes = vec![0; size];
        reader.read_exact(&mut planes)?;
        Ok(planes)
    };
    let wrong = |error: std::io::Error| PriorError::Field {
        format: part,
        offset: at as u64,
        reason: format!("LZMA: {error}"),
    };
    read().map_err(wrong)
}
