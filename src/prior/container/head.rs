//! The first bytes of a file.

use super::super::{PriorError, PriorId, Splats};

const VERSION: u8 = 1;
/// Bytes before the check.
const CHECKED: usize = 24;

/// What a file is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// A compact prior, `.nvsg`.
    Compact,
    /// A prior in blocks, `.nvsb`.
    Blocked,
    /// What lies beside a foreign prior, `.nvsx`.
    Beside,
}

impl Format {
    /// How its files start.
    pub const fn magic(self) -> [u8; 4] {
        match self {
            Format::Compact => *b"nvsg",
            Format::Blocked => *b"nvsb",
            Format::Beside => *b"nvsx",
        }
    }

    /// What errors call it.
    pub const fn text(self) -> &'static str {
        match self {
            Format::Compact => "compact prior",
            Format::Blocked => "blocked prior",
            Format::Beside => "parts beside a prior",
        }
    }

    /// A field at byte `offset` that no writer leaves so.
    pub fn refusal(self, offset: usize, reason: String) -> PriorError {
        PriorError::Field { format: self.text(), offset: offset as u64, reason }
    }
}

/// What the first bytes of a file say.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Head {
    pub format: Format,
    pub sh_degree: u32,
    /// How many parts follow.
    pub parts: u16,
    pub id: PriorId,
    pub splats: u32,
    /// Byte at which the last part ends.
    pub end: u64,
}

impl Head {
    pub const BYTES: usize = CHECKED + 4;

    /// That of a file without parts.
    pub fn new(format: Format, sh_degree: u32, splats: usize, id: PriorId) -> Head {
        Head { format, sh_degree, parts: 0, id, splats: splats as u32, end: Head::BYTES as u64 }
    }

    pub fn to_bytes(self) -> [u8; Head::BYTES] {
        let mut bytes = [0; Head::BYTES];
        bytes[..4].copy_from_slice(&self.format.magic());
        (bytes[4], bytes[5]) = (VERSION, self.sh_degree as u8);
        bytes[6..8].copy_from_slice(&self.parts.to_le_bytes());
        bytes[8..12].copy_from_slice(&self.id.to_bytes());
        bytes[12..16].copy_from_slice(&self.splats.to_le_bytes());
        bytes[16..24].copy_from_slice(&self.end.to_le_bytes());
        let check = crc32fast::hash(&bytes[..CHECKED]);
        bytes[CHECKED..].copy_from_slice(&check.to_le_bytes());
        bytes
    }

    /// Reads the head of a file of `size` bytes, of which `bytes` are the first.
    pub fn read(bytes: &[u8], format: Format, size: u64) -> Result<Head, PriorError> {
        let truncated = |needed: u64| PriorError::Truncated {
            needed: needed.into(),
            found: usize::try_from(size).unwrap_or(usize::MAX),
        };
        if !bytes.starts_with(&format.magic()) {
            return Err(PriorError::UnknownFormat);
        }
        let bytes: &[u8; Head::BYTES] =
            bytes.first_chunk().ok_or_else(|| truncated(Head::BYTES as u64))?;
        if bytes[4] != VERSION {
            let (version, known) = (bytes[4].into(), VERSION.into());
            return Err(PriorError::Newer { format: format.text(), version, known });
        }
        let word = |at: usize| u32::from_le_bytes(std::array::from_fn(|i| bytes[at + i]));
        let (stated, found) = (word(CHECKED), crc32fast::hash(&bytes[..CHECKED]));
        if stated != found {
            return Err(PriorError::Damaged { stated, found });
        }
        let end = u64::from(word(16)) | u64::from(word(20)) << 32;
        let head = Head {
            format,
            sh_degree: bytes[5].into(),
            parts: u16::from_le_bytes([bytes[6], bytes[7]]),
            id: PriorId(word(8)),
            splats: word(12),
            end,
        };
        match head {
            _ if head.sh_degree > Splats::MAX_SH_DEGREE => {
                Err(PriorError::ShDegree { degree: head.sh_degree })
            }
            _ if head.splats == 0 => Err(PriorError::Empty),
            _ if end < Head::BYTES as u64 => {
                Err(format.refusal(16, format!("parts that end at byte {end}")))
            }
            _ if end > size => Err(truncated(end)),
            _ => Ok(head),
        }
    }
}
