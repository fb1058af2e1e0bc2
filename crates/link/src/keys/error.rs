//! Why keys cannot be used, and why a frame is refused.

use nvsprior::ErrorKind;

use super::limits::{KEY_LEN, MAX_KEYS, MAX_NUMBER, MAX_TAG_BYTES, MIN_TAG_BYTES};

/// Why keys cannot be used. No text holds anything of a key.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs)] // Their texts tell.
pub enum KeyError {
    #[error("{0} keys: there must be 1 to {MAX_KEYS}")]
    Count(usize),
    #[error("line {line}: a key is {} hexadecimal digits by themselves on a line", 2 * KEY_LEN)]
    Line { line: usize },
    #[error("the same key twice")]
    Twice,
    #[error("tags of {0} bytes: they have {MIN_TAG_BYTES} to {MAX_TAG_BYTES}")]
    TagBytes(usize),
    #[error("a first number of {0}: it must lie below {MAX_NUMBER}")]
    Number(u64),
}

/// Why a verifier refuses something.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Refusal {
    /// Made without a key that is held, for another epoch or another kind of content, or damaged.
    #[error("no key that is held has made its tag: of a stranger or of another epoch, or damaged")]
    Foreign,
    /// Made with the key, and taken before or long past.
    #[error("its number was taken before: it comes a second time")]
    Replayed,
}

impl Refusal {
    /// What kind of failure it is.
    pub fn kind(&self) -> ErrorKind {
        match self {
            Refusal::Foreign => ErrorKind::Foreign,
            Refusal::Replayed => ErrorKind::Replayed,
        }
    }
}

impl KeyError {
    /// What kind of failure it is.
    pub fn kind(&self) -> ErrorKind {
        ErrorKind::Argument
    }
}
