//! The files of an end of a link: its keys, and what it goes on with after a restart.

use std::io::ErrorKind;

use gst::prelude::*;
use nvsprior::prior::replace_file;
use nvsprior_link::keys::{DEFAULT_TAG_BYTES, KeyError, Keys};
use zeroize::Zeroizing;

/// Values of the properties about them.
#[derive(Clone, Debug)]
pub struct EndFiles {
    pub key_file: Option<String>,
    pub epoch: u64,
    pub tag_bytes: u32,
    pub state_file: Option<String>,
}

/// Why one cannot be used. No text holds anything of keys.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    #[error("property {property}: {file}: {error}")]
    File { property: &'static str, file: String, error: std::io::Error },
    #[error("property key-file: {file}: {error}")]
    Keys { file: String, error: KeyError },
}

impl Default for EndFiles {
    fn default() -> EndFiles {
        let tag_bytes = DEFAULT_TAG_BYTES as u32;
        EndFiles { key_file: None, epoch: 0, tag_bytes, state_file: None }
    }
}

impl EndFiles {
    /// The keys, if a file is named, and the state: empty if there is none yet.
    pub fn read(&self) -> Result<(Option<Keys>, Vec<u8>), gst::ErrorMessage> {
        let read = || Ok((self.keys()?, self.state()?));
        read()
            .map_err(|error: FileError| gst::error_msg!(gst::ResourceError::OpenRead, ("{error}")))
    }

    fn keys(&self) -> Result<Option<Keys>, FileError> {
        let Some(file) = self.key_file.clone() else { return Ok(None) };
        let text = match std::fs::read_to_string(&file) {
            Ok(text) => Zeroizing::new(text),
            Err(error) => return Err(FileError::File { property: "key-file", file, error }),
        };
        let keys = Keys::parse(&text)
            .and_then(|keys| keys.with_epoch(self.epoch).with_tag_bytes(self.tag_bytes as usize));
        keys.map(Some).map_err(|error| FileError::Keys { file, error })
    }

    fn state(&self) -> Result<Vec<u8>, FileError> {
        let Some(file) = self.state_file.clone() else { return Ok(Vec::new()) };
        match std::fs::read(&file) {
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(Vec::new()),
            read => read.map_err(|error| FileError::File { property: "state-file", file, error }),
        }
    }

    /// Stores a state, if a file is named. If it cannot be, a warning says so: the dive goes on.
    pub fn store(&self, element: &impl IsA<gst::Element>, state: impl FnOnce(&mut Vec<u8>)) {
        let Some(file) = self.state_file.clone() else {
            return state(&mut Vec::new());
        };
        let mut bytes = Vec::new();
        state(&mut bytes);
        if let Err(error) = replace_file(file.as_ref(), &bytes) {
            gst::element_warning!(
                element,
                gst::ResourceError::Write,
                ("property state-file: {error}")
            );
        }
    }
}
