//! Files of updates.

use std::path::Path;

use super::super::{beside, replace::replace_file};
use super::UpdateError;
use super::chain::{ChainRead, UpdateChain};
use super::content::Update;
use super::limits::MAX_UPDATE_BYTES;

/// More bytes than any chain of updates takes: dives of a year.
const MAX_CHAIN_BYTES: u64 = 1 << 26;

impl Update {
    /// Reads a file. Errors name it.
    pub fn open(path: &Path) -> Result<Update, UpdateError> {
        let read = || Update::read(&beside::read(path, MAX_UPDATE_BYTES as u64, "an update")?);
        read().map_err(|error| error.in_file(path))
    }

    /// Writes a file, which is there whole or not at all. Errors name it.
    pub fn save(&self, path: &Path) -> Result<(), UpdateError> {
        let mut bytes = Vec::new();
        self.write(&mut bytes).map_err(|error| error.in_file(path))?;
        Ok(replace_file(path, &bytes)?)
    }
}

impl UpdateChain {
    /// Reads a file, as [`UpdateChain::read`]. Errors name it.
    pub fn open(path: &Path) -> Result<ChainRead, UpdateError> {
        let read = || UpdateChain::read(&beside::read(path, MAX_CHAIN_BYTES, "updates")?);
        let read = read().map_err(|error| error.in_file(path))?;
        let left_out = read.left_out.map(|error| error.in_file(path));
        Ok(ChainRead { left_out, ..read })
    }

    /// Writes a file, which is there whole or not at all: if that fails, the one before stays. Errors name it.
    pub fn save(&self, path: &Path) -> Result<(), UpdateError> {
        let mut bytes = Vec::new();
        self.write(&mut bytes).map_err(|error| error.in_file(path))?;
        Ok(replace_file(path, &bytes)?)
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::id::PriorId;
    use super::super::tests::sample;
    use super::*;

    #[test]
    fn files_come_back_and_errors_name_them() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("dive.0001.nvsu");
        let update = sample(1, 30);
        update.save(&path).unwrap();
        assert_eq!(Update::open(&path).unwrap(), update);
        let bad = Update { number: 0, ..update };
        let error = bad.save(&path).unwrap_err().to_string();
        assert!(error.contains("dive.0001.nvsu: the update has the number 0"), "{error}");
        assert!(Update::open(&path).is_ok(), "the file stays");
        std::fs::write(&path, b"nvsu").unwrap();
        let error = Update::open(&path).unwrap_err().to_string();
        assert!(error.contains("dive.0001.nvsu: truncated: "), "{error}");
        let error = Update::open(&folder.path().join("none.nvsu")).unwrap_err().to_string();
        assert!(error.contains("none.nvsu: "), "{error}");
        let error = Update::open(folder.path()).unwrap_err().to_string();
        assert!(error.contains("no file of an update"), "{error}");
        let error = sample(1, 3).save(&folder.path().join("no/a.nvsu")).unwrap_err().to_string();
        assert!(error.contains("no/a.nvsu: writing: "), "{error}");
    }

    #[test]
    fn chains_come_back_also_half_written_ones() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("dive.nvsu");
        let mut chain = UpdateChain::none(PriorId(7));
        chain.add(sample(1, 30)).unwrap();
        chain.save(&path).unwrap();
        let read = UpdateChain::open(&path).unwrap();
        assert_eq!((read.chain, read.left_out.is_none()), (chain.clone(), true));
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, [&bytes[..], &[9, 0, 0]].concat()).unwrap();
        let read = UpdateChain::open(&path).unwrap();
        assert_eq!(read.chain, chain);
        let error = read.left_out.unwrap().to_string();
        assert!(error.contains("dive.nvsu: update 2 and all after it are left out: "), "{error}");
        std::fs::write(&path, b"nvsc").unwrap();
        let error = UpdateChain::open(&path).unwrap_err().to_string();
        assert!(error.contains("dive.nvsu: truncated: "), "{error}");
        let error = chain.save(&folder.path().join("no/dive.nvsu")).unwrap_err().to_string();
        assert!(error.contains("no/dive.nvsu: writing: "), "{error}");
    }

    #[test]
    fn long_files_are_refused_before_they_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("long.nvsu");
        let file = std::fs::File::create(&path).unwrap();
        file.set_len(1 << 40).unwrap();
        let error = Update::open(&path).unwrap_err().to_string();
        assert!(error.contains("too long for a file of an update"), "{error}");
    }
}
