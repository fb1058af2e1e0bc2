//! A part of a file.

use std::borrow::Cow;

use super::super::PriorError;
use super::head::Format;

/// Bytes of a name: letters a to z, filled up with zeros.
pub const NAME_BYTES: usize = 8;
/// Bytes before the content: name, flags, length, check.
const START: usize = NAME_BYTES + 1 + 8 + 4;
/// Bytes of these before the check.
const CHECKED: usize = START - 4;

/// The identity covers the part.
const COVERED: u8 = 1;
/// Who does not know the part must refuse the file.
const REQUIRED: u8 = 2;

/// A part that is known here, by its name in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PartName {
    pub text: &'static str,
    flags: u8,
}

impl PartName {
    /// Render options.
    pub const OPTIONS: PartName = PartName::covered("options");
    /// The coordinate frame, if it is not that of the splats.
    pub const FRAME: PartName = PartName::covered("frame");
    /// Coder tables.
    pub const TABLES: PartName = PartName::covered("tables");
    /// The point that positions count from, if it is not zero.
    pub const ORIGIN: PartName = PartName::covered("origin");
    /// Splats in steps.
    pub const SPLATS: PartName = PartName::covered("splats");
    /// Splats as they are.
    pub const EXACT: PartName = PartName::covered("exact");
    /// Where blocks of splats lie, in the file and in space.
    pub const BLOCKS: PartName = PartName::covered("blocks");
    pub const KEY_FRAMES: PartName = PartName::besides("keys");
    pub const PREPROCESSING: PartName = PartName::besides("treated");
    pub const LENS: PartName = PartName::besides("lens");
    /// Weights of the display filter.
    pub const FILTER: PartName = PartName::besides("filter");
    pub const DOUBT: PartName = PartName::besides("doubt");
    /// Pictures that were held out of the training, and found.
    pub const POSE_TRIALS: PartName = PartName::besides("trials");
    /// The dives that the prior was trained on since it was mapped.
    pub const RECORD: PartName = PartName::besides("record");

    #[rustfmt::skip]
    const ALL: [PartName; 14] = [
        Self::OPTIONS, Self::FRAME, Self::TABLES, Self::ORIGIN, Self::SPLATS, Self::EXACT, Self::BLOCKS,
        Self::KEY_FRAMES, Self::PREPROCESSING, Self::LENS, Self::FILTER, Self::DOUBT, Self::POSE_TRIALS,
        Self::RECORD,
    ];

    const fn covered(text: &'static str) -> PartName {
        PartName { text, flags: COVERED | REQUIRED }
    }

    const fn besides(text: &'static str) -> PartName {
        PartName { text, flags: 0 }
    }

    /// As in a file.
    pub fn bytes(self) -> [u8; NAME_BYTES] {
        let text = self.text.as_bytes();
        std::array::from_fn(|i| text.get(i).copied().unwrap_or(0))
    }
}

/// A part, known here or not.
#[derive(Clone, Debug)]
pub struct Part<'a> {
    pub name: [u8; NAME_BYTES],
    flags: u8,
    /// Byte of the file at which its content begins.
    pub at: usize,
    pub content: Cow<'a, [u8]>,
}

impl<'a> Part<'a> {
    /// One that is written.
    pub fn new(name: PartName, content: Vec<u8>) -> Part<'a> {
        Part { name: name.bytes(), flags: name.flags, at: 0, content: content.into() }
    }

    /// Reads the part that begins at byte `at` of a file.
    pub fn read(bytes: &'a [u8], at: usize, format: Format) -> Result<Part<'a>, PriorError> {
        let truncated = |needed: u128| PriorError::Truncated { needed, found: bytes.len() };
        let content = at + START;
        let start: &[u8; START] =
            bytes[at..].first_chunk().ok_or_else(|| truncated(content as u128))?;
        let name: [u8; NAME_BYTES] = std::array::from_fn(|i| start[i]);
        let letters = name.iter().take_while(|byte| byte.is_ascii_lowercase()).count();
        if letters == 0 || name[letters..].iter().any(|byte| *byte != 0) {
            return Err(format.refusal(at, "no name of a part".into()));
        }
        let length = u64::from_le_bytes(std::array::from_fn(|i| start[NAME_BYTES + 1 + i]));
        let end = content as u128 + u128::from(length);
        let size = usize::try_from(length).map_err(|_| truncated(end))?;
        let within = bytes[content..].get(..size).ok_or_else(|| truncated(end))?;
        let part = Part { name, flags: start[NAME_BYTES], at: content, content: within.into() };
        let stated = u32::from_le_bytes(std::array::from_fn(|i| start[CHECKED + i]));
        let found = part.check();
        if stated != found {
            return Err(part.in_part(PriorError::Damaged { stated, found }));
        }
        part.check_flags(format)?;
        Ok(part)
    }

    /// Refuses flags that no writer leaves, and a part that must be understood but is not known here.
    fn check_flags(&self, format: Format) -> Result<(), PriorError> {
        let known = PartName::ALL.into_iter().find(|name| self.is(*name));
        let flags = [0, REQUIRED, COVERED | REQUIRED];
        let possible = known.map_or(flags.contains(&self.flags), |n| n.flags == self.flags);
        if !possible {
            let at = self.at - START + NAME_BYTES;
            let reason = format!("flags {} of part {}", self.flags, self.name());
            return Err(format.refusal(at, reason));
        }
        match known.is_none() && self.flags & REQUIRED != 0 {
            true => Err(PriorError::UnknownPart { part: self.name() }),
            false => Ok(()),
        }
    }

    pub fn is(&self, name: PartName) -> bool {
        self.name == name.bytes()
    }

    /// Its name, for errors.
    pub fn name(&self) -> String {
        let letters: String = self.name.iter().filter(|b| **b != 0).map(|b| *b as char).collect();
        format!("\"{letters}\"")
    }

    /// What `read` makes of its content; an error names the part.
    pub fn read_content<T>(
        &self,
        read: impl FnOnce(&[u8], usize) -> Result<T, PriorError>,
    ) -> Result<T, PriorError> {
        read(&self.content, self.at).map_err(|error| self.in_part(error))
    }

    pub fn in_part(&self, error: PriorError) -> PriorError {
        PriorError::InPart { part: self.name(), error: Box::new(error) }
    }

    /// Byte of the file behind it.
    pub fn end(&self) -> usize {
        self.at + self.content.len()
    }

    /// Bytes that it takes.
    pub fn size(&self) -> usize {
        START + self.content.len()
    }

    fn start(&self) -> [u8; CHECKED] {
        let mut start = [0; CHECKED];
        start[..NAME_BYTES].copy_from_slice(&self.name);
        start[NAME_BYTES] = self.flags;
        start[NAME_BYTES + 1..].copy_from_slice(&(self.content.len() as u64).to_le_bytes());
        start
    }

    /// The check of all but itself.
    fn check(&self) -> u32 {
        let mut check = crc32fast::Hasher::new();
        check.update(&self.start());
        check.update(&self.content);
        check.finalize()
    }

    pub fn put(&self, bytes: &mut Vec<u8>) {
        bytes.extend(self.start());
        bytes.extend(self.check().to_le_bytes());
        bytes.extend(&*self.content);
    }
}
