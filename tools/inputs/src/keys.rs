//! Keys on the command line.

use std::path::{Path, PathBuf};

use anyhow::Context;
use nvsprior_link::keys::{DEFAULT_TAG_BYTES, KeyError, Keys, MAX_TAG_BYTES, MIN_TAG_BYTES};
use zeroize::Zeroizing;

/// A key that both sides hold.
#[derive(clap::Args)]
pub struct KeyArgs {
    /// File with a key that both sides hold, as `nvsprior key` makes it. What goes to the other side then has a tag,
    /// and what comes without the right one is counted and not used. Up to four keys, one a line: tags are made by the
    /// first, and checked by all
    #[arg(long, value_name = "FILE")]
    pub key: Option<PathBuf>,
    /// Number of the dive. Both sides need the same, and nothing of another dive passes
    #[arg(long, value_name = "N", default_value_t = 0, requires = "key")]
    epoch: u64,
    /// Bytes of a tag, 2 to 16. Both sides need the same
    #[arg(long = "tag", value_name = "BYTES", default_value_t = DEFAULT_TAG_BYTES, requires = "key",
        value_parser = tag_bytes)]
    tag_bytes: usize,
}

/// Why a key file cannot be used. No text holds anything of it.
#[derive(Debug, thiserror::Error)]
pub enum KeyFileError {
    #[error("--key {}: {source}", file.display())]
    Content { file: PathBuf, source: KeyError },
    #[error("--key {}: longer than {MAX_FILE} bytes, so it is no key file", file.display())]
    TooLong { file: PathBuf },
}

/// Most bytes of a key file.
const MAX_FILE: u64 = 1 << 16;

fn tag_bytes(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(bytes) if (MIN_TAG_BYTES..=MAX_TAG_BYTES).contains(&bytes) => Ok(bytes),
        _ => Err(format!("must lie between {MIN_TAG_BYTES} and {MAX_TAG_BYTES}")),
    }
}

/// Which key that is, for the user.
impl std::fmt::Display for KeyArgs {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match &self.key {
            Some(file) => write!(f, "the key in {}, epoch {}", file.display(), self.epoch),
            None => write!(f, "no key"),
        }
    }
}

impl KeyArgs {
    /// The keys, if there are any. Says so if others than the file's owner may read it.
    pub fn open(&self) -> anyhow::Result<Option<Keys>> {
        let Some(path) = &self.key else { return Ok(None) };
        let keys = read(path)?.with_epoch(self.epoch).with_tag_bytes(self.tag_bytes)?;
        Ok(Some(keys))
    }
}

fn read(path: &Path) -> anyhow::Result<Keys> {
    let named = || format!("--key {}", path.display());
    let file = std::fs::metadata(path).with_context(named)?;
    if file.len() > MAX_FILE {
        return Err(KeyFileError::TooLong { file: path.to_owned() }.into());
    }
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        if file.permissions().mode() & 0o077 != 0 {
            tell!("{}: others than its owner may use this key file: chmod 600", path.display());
        }
    }
    let text = Zeroizing::new(std::fs::read_to_string(path).with_context(named)?);
    let wrong = |source| KeyFileError::Content { file: path.to_owned(), source };
    Ok(Keys::parse(&text).map_err(wrong)?)
}
