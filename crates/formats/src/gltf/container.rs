//! The chunks of a binary glTF file.

use nvsprior::prior::PriorError;

/// How binary glTF files start.
pub const MAGIC: &[u8] = b"glTF";

const HEADER: usize = 12;
const CHUNK_HEADER: usize = 8;

/// The chunks that are read.
pub struct Container<'a> {
    /// The document.
    pub json: &'a [u8],
    /// What accessors show; empty if the file has none.
    pub data: &'a [u8],
    /// Where `data` begins in the file.
    pub data_start: usize,
}

impl Container<'_> {
    /// Finds the chunks. Bytes after them, and chunks of other kinds, are ignored, as glTF asks.
    pub fn read(bytes: &[u8]) -> Result<Container<'_>, PriorError> {
        if !bytes.starts_with(MAGIC) {
            return Err(PriorError::UnknownFormat);
        }
        let version = word(bytes, 4)?;
        if version != 2 {
            return Err(refusal(format!("version {version} of the container: 2 is known")));
        }
        let length = word(bytes, 8)? as usize;
        if length > bytes.len() {
            return Err(PriorError::Truncated { needed: length as u128, found: bytes.len() });
        }
        let (json_start, json) = chunk(bytes, HEADER, b"JSON")?;
        let after = json_start + json.len();
        let (data_start, data) = match after < length {
            true => chunk(bytes, after, b"BIN\0")?,
            false => (after, &[][..]),
        };
        Ok(Container { json, data, data_start })
    }
}

/// The chunk whose header stands at byte `at`: where its content begins, and the content.
fn chunk<'a>(bytes: &'a [u8], at: usize, kind: &[u8; 4]) -> Result<(usize, &'a [u8]), PriorError> {
    let (size, start) = (word(bytes, at)? as usize, at + CHUNK_HEADER);
    if bytes.get(at + 4..start) != Some(kind) {
        let name = String::from_utf8_lossy(&kind[..3]).into_owned();
        return Err(refusal(format!("no chunk {name} at byte {at}")));
    }
    let end = start.saturating_add(size);
    let needed = PriorError::Truncated { needed: end as u128, found: bytes.len() };
    Ok((start, bytes.get(start..end).ok_or(needed)?))
}

fn word(bytes: &[u8], at: usize) -> Result<u32, PriorError> {
    let found = bytes.get(at..).and_then(|rest| rest.first_chunk());
    let needed = PriorError::Truncated { needed: at as u128 + 4, found: bytes.len() };
    Ok(u32::from_le_bytes(*found.ok_or(needed)?))
}

/// An error of the file's content.
pub fn refusal(reason: String) -> PriorError {
    PriorError::Content { format: "glTF", reason }
}
