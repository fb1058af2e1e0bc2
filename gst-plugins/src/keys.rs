//! The properties about keys, which `nvsppay` and `nvspdepay` have.

use std::path::PathBuf;

use nvsprior::keys::{DEFAULT_TAG_BYTES, KeyError, Keys};
use zeroize::Zeroizing;

/// Values of the properties.
#[derive(Clone, Debug)]
pub struct KeySettings {
    pub key_file: Option<String>,
    pub epoch: u64,
    pub tag_bytes: u32,
    /// Number of the first thing that is sent.
    pub first_number: u64,
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
        KeySettings { key_file: None, epoch: 0, tag_bytes, first_number: 0 }
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
        let keys = Keys::parse(&text).and_then(|keys| {
            keys.with_epoch(self.epoch)
                .with_tag_bytes(self.tag_bytes as usize)?
                .with_number(self.first_number)
        });
        keys.map(Some).map_err(|error| KeyFileError::Content { file, error })
    }
}

/// What sets and tells the properties: the derive macro reaches no further than a member of the settings.
macro_rules! key_properties {
    () => {
        fn key_file(&self) -> Option<String> {
            crate::lock::lock(&self.settings).keys.key_file.clone()
        }

        fn set_key_file(&self, file: Option<String>) {
            crate::lock::lock(&self.settings).keys.key_file = file;
        }

        fn epoch(&self) -> u64 {
            crate::lock::lock(&self.settings).keys.epoch
        }

        fn set_epoch(&self, epoch: u64) {
            crate::lock::lock(&self.settings).keys.epoch = epoch;
        }

        fn tag_bytes(&self) -> u32 {
            crate::lock::lock(&self.settings).keys.tag_bytes
        }

        fn set_tag_bytes(&self, bytes: u32) {
            crate::lock::lock(&self.settings).keys.tag_bytes = bytes;
        }

        fn first_number(&self) -> u64 {
            crate::lock::lock(&self.settings).keys.first_number
        }

        fn set_first_number(&self, number: u64) {
            crate::lock::lock(&self.settings).keys.first_number = number;
        }
    };
}
pub(crate) use key_properties;
