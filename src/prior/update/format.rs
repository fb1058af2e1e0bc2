//! An update as bytes.

use super::super::id::PriorId;
use super::UpdateError;
use super::body::Body;
use super::content::Update;
use super::state::StateId;
use crate::range_coder::RangeEncoder;
use crate::range_coder::WholeReader;

/// How an update starts.
pub const MAGIC: &[u8] = b"nvsu";
const VERSION: u8 = 1;
/// Bytes before the coded part.
pub(super) const HEADER: usize = 15;
/// Bytes of the check at the end.
const CHECK: usize = 4;

impl Update {
    /// The update as it travels: see [`Update::write`].
    pub fn to_bytes(&self) -> Result<Vec<u8>, UpdateError> {
        let mut bytes = Vec::new();
        self.write(&mut bytes)?;
        Ok(bytes)
    }

    /// Appends it as bytes. The same update gives the same bytes, whatever the order of its splats.
    ///
    /// Fails if [`Update::check`] does, and appends nothing then.
    pub fn write(&self, into: &mut Vec<u8>) -> Result<(), UpdateError> {
        self.check()?;
        let start = into.len();
        into.extend(MAGIC);
        into.push(VERSION);
        into.extend(self.prior.to_bytes());
        into.extend(self.number.to_le_bytes());
        into.extend(self.before.0.to_le_bytes());
        into.extend(self.coded());
        let check = crc32fast::hash(&into[start..]);
        into.extend(check.to_le_bytes());
        Ok(())
    }

    fn coded(&self) -> Vec<u8> {
        let body = Body {
            origin: self.grid.origin.map(f32::to_bits),
            exponent: self.grid.exponent,
            frames: self.frames,
            splats: self.ordered(),
            removed: self.removed.clone(),
            changed: self.changed.clone(),
            fades: self.fades.clone(),
        };
        let mut bytes = Vec::new();
        let mut encoder = RangeEncoder::new(&mut bytes, usize::MAX);
        let coded = body.code(&mut encoder);
        debug_assert_eq!(coded.as_ref(), Ok(&body), "checked before");
        encoder.finish();
        bytes
    }

    /// Reads an update. It takes no more than some hundred kilobytes of memory, whatever the bytes are.
    ///
    /// Fails if a byte was changed or cut off, or if [`Update::write`] does not write it so.
    pub fn read(bytes: &[u8]) -> Result<Update, UpdateError> {
        if !bytes.starts_with(MAGIC) {
            return Err(UpdateError::UnknownFormat);
        }
        let truncated = || UpdateError::Truncated { needed: HEADER + CHECK, found: bytes.len() };
        let (content, check) = bytes.split_last_chunk::<CHECK>().ok_or_else(truncated)?;
        let coded = content.get(HEADER..).ok_or_else(truncated)?;
        let (stated, found) = (u32::from_le_bytes(*check), crc32fast::hash(content));
        if stated != found {
            return Err(UpdateError::Damaged { stated, found });
        }
        if content[4] != VERSION {
            return Err(UpdateError::Newer { version: content[4], known: VERSION });
        }
        let refuse = |reason| UpdateError::Field { offset: HEADER, reason };
        let body = Body::default().code(&mut WholeReader::new(coded)).map_err(refuse)?;
        let word = |at: usize| std::array::from_fn(|i| content[at + i]);
        let update = Update {
            prior: PriorId::from_bytes(word(5)),
            number: u16::from_le_bytes([content[9], content[10]]),
            before: StateId(u32::from_le_bytes(word(11))),
            grid: body.grid(),
            splats: body.splats,
            removed: body.removed,
            changed: body.changed,
            fades: body.fades,
            frames: body.frames,
        };
        update.check()?;
        // An update has one form, so that nothing can hide in it. This also finds bytes behind its end.
        if update.coded() != coded {
            return Err(refuse("not as it is written".into()));
        }
        Ok(update)
    }
}
