//! The properties about keys, of the two ends of a link.

use std::path::PathBuf;

use nvsprior::keys::{DEFAULT_TAG_BYTES, KeyError, Keys};
use zeroize::Zeroizing;

/// Values of the properties.
#[derive(Clone, Debug)]
pub struct KeySettings {
    pub key_file: Option<String>,
    pub epoch: u64,
    pub tag_bytes: u32,
}

/// Why the keys cannot be used. No text holds anything of them.
#[derive(Debug, thiserror::Error)]
pub enum KeyFileError {
    #[error("property key-file: {}: {error}", file.display())]
    Read { file: PathBuf, error: std::io::Error },
    #[error("property key-file: {}: {error}", file.display())]
    Content { file: PathBuf, error: KeyError },
}

impl Default for KeySettings {
    fn default() -> KeySettings {
        let tag_bytes = DEFAULT_TAG_BYTES as u32;
        KeySettings { key_file: None, epoch: 0, tag_bytes }
    }
}

impl KeySettings {
    /// The keys, if a file is named.
    pub fn open(&self) -> Result<Option<Keys>, KeyFileError> {
        let Some(file) = &self.key_file else { return Ok(None) };
        let file = PathBuf::from(file);
        let text = match std::fs::read_to_string(&file) {
            Ok(text) => Zeroizing::new(text),
            Err(error) => return Err(KeyFileError::Read { file, error }),
        };
        let keys = Keys::parse(&text)
            .and_then(|keys| keys.with_epoch(self.epoch).with_tag_bytes(self.tag_bytes as usize));
        keys.map(Some).map_err(|error| KeyFileError::Content { file, error })
    }
}
