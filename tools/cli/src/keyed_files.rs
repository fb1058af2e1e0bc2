//! Packets in files, with the tags of keys.

use std::collections::BTreeSet;
use std::path::Path;

use anyhow::Context;
use nvsprior_link::keys::{Authenticator, Content, Keys, Refusal, Verifier};

/// Makes what files of packets hold, with tags if there are keys.
pub struct FileTags {
    authenticator: Option<Authenticator>,
    bytes: Vec<u8>,
}

impl FileTags {
    pub fn new(keys: Option<&Keys>) -> FileTags {
        let authenticator = keys.map(|keys| Authenticator::new(keys, Content::Packet));
        FileTags { authenticator, bytes: Vec::new() }
    }

    /// What the next file holds.
    pub fn put<'a>(&'a mut self, content: &'a [u8]) -> &'a [u8] {
        let Some(authenticator) = &mut self.authenticator else { return content };
        authenticator.write(0, content, &mut self.bytes);
        &self.bytes
    }
}

/// Reads such files. With keys it takes each number of a key once; files may come in any order.
pub struct FileReader {
    verifier: Option<Verifier>,
    /// Key ids and numbers.
    taken: BTreeSet<(u32, u64)>,
}

impl FileReader {
    pub fn new(keys: Option<&Keys>) -> FileReader {
        let verifier = keys.map(|keys| Verifier::new(keys, Content::Packet));
        FileReader { verifier, taken: BTreeSet::new() }
    }

    /// The content of a file.
    ///
    /// # Errors
    /// If it cannot be read, or no key has made its tag, or one like it was read before.
    pub fn read(&mut self, path: &Path) -> anyhow::Result<Vec<u8>> {
        let mut bytes = std::fs::read(path).with_context(|| path.display().to_string())?;
        let Some(verifier) = &self.verifier else { return Ok(bytes) };
        // Names may have another order than numbers: what was taken is kept here, without end.
        let verified = verifier.clone().verify(&bytes)?;
        if !self.taken.insert((verified.key.0, verified.number)) {
            return Err(Refusal::Replayed.into());
        }
        bytes.drain(..verifier.overhead());
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use nvsprior_link::keys::Key;

    use super::*;

    #[test]
    fn files_come_back_in_any_order_and_none_twice() {
        let folder = tempfile::tempdir().unwrap();
        let keys = Keys::new([Key::new([4; 32])]).unwrap();
        let path = |index: u32| folder.path().join(format!("{index}.nvsp"));
        let mut tags = FileTags::new(Some(&keys));
        for index in 0..200_u32 {
            std::fs::write(path(index), tags.put(&index.to_le_bytes())).unwrap();
        }
        std::fs::copy(path(7), path(1000)).unwrap();
        std::fs::write(path(1001), FileTags::new(None).put(b"no tag")).unwrap();
        let mut reader = FileReader::new(Some(&keys));
        for index in (0..200).rev() {
            assert_eq!(reader.read(&path(index)).unwrap(), index.to_le_bytes());
        }
        let refused = |reader: &mut FileReader, index| {
            *reader.read(&path(index)).unwrap_err().downcast_ref::<Refusal>().unwrap()
        };
        assert_eq!(refused(&mut reader, 1000), Refusal::Replayed);
        assert_eq!(refused(&mut reader, 1001), Refusal::Foreign);
        assert_eq!(FileReader::new(None).read(&path(1001)).unwrap(), b"no tag");
    }
}
