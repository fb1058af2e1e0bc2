//! What a side has learnt, in a file: the updates of this dive and of those before.

use std::path::PathBuf;

use nvsprior::PriorId;
use nvsprior::prior::update::DIVE_FILE;
use nvsprior::prior::{Update, UpdateChain, UpdateError};

use crate::property::PropertyError;

pub struct DiveFile {
    path: PathBuf,
    chain: UpdateChain,
}

impl DiveFile {
    /// Goes on from the updates in a file, or in `dive.nvsu` in a folder; without such a file, from none. Writes
    /// nothing yet. Also tells why some updates are left out, if any are.
    pub fn open(
        property: &'static str,
        path: &str,
        prior: PriorId,
    ) -> Result<(DiveFile, Option<UpdateError>), PropertyError> {
        let path = PathBuf::from(path);
        let path = if path.is_dir() { path.join(DIVE_FILE) } else { path };
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        if folder.is_some_and(|folder| !folder.is_dir()) {
            return Err(PropertyError::NoFolder { name: property, file: path });
        }
        if !path.exists() {
            return Ok((DiveFile { path, chain: UpdateChain::none(prior) }, None));
        }
        let wrong = |error| PropertyError::Updates { name: property, error };
        let read = UpdateChain::open(&path).map_err(wrong)?;
        let stated = read.chain.learnt().prior();
        if stated != prior {
            return Err(wrong(UpdateError::Foreign { stated, prior }.in_file(&path)));
        }
        Ok((DiveFile { path, chain: read.chain }, read.left_out))
    }

    pub fn chain(&self) -> &UpdateChain {
        &self.chain
    }

    /// The updates as they travel.
    pub fn each_bytes(&self) -> Result<Vec<Vec<u8>>, UpdateError> {
        self.chain.updates().iter().map(Update::to_bytes).collect()
    }

    /// Takes an update, see [`UpdateChain::take`], and writes the file if that changes what is kept. If it cannot be
    /// written, nothing is kept: the update may come again.
    pub fn add(&mut self, update: Update) -> Result<(), UpdateError> {
        let mut chain = self.chain.clone();
        if chain.take(update)? {
            chain.save(&self.path)?;
            self.chain = chain;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use nvsprior::prior::{Learnt, NewSplat, UpdateGrid};

    use super::*;

    const PRIOR: PriorId = PriorId(7);

    fn update(learnt: &Learnt, splats: usize) -> Update {
        Update {
            prior: PRIOR,
            number: learnt.number() + 1,
            before: learnt.state(),
            grid: UpdateGrid { origin: [0.0; 3], exponent: -4 },
            splats: (0..splats as i32)
                .map(|k| NewSplat { position: [k, 0, 0], log_scale: [-6; 3], ..Default::default() })
                .collect(),
            removed: vec![],
            changed: vec![],
            fades: vec![],
            frames: [0, 1],
        }
    }

    fn open(path: &str) -> DiveFile {
        let (file, left_out) = DiveFile::open("updates", path, PRIOR).unwrap();
        assert!(left_out.is_none());
        file
    }

    #[test]
    fn a_dive_goes_on_and_begins_anew() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().display().to_string();
        let mut file = open(&path);
        assert!(file.chain().updates().is_empty() && !file.path.exists());
        for count in [3, 4, 5] {
            let update = update(file.chain().learnt(), count);
            file.add(update.clone()).unwrap();
            file.add(update).unwrap();
        }
        let mut again = open(&format!("{path}/dive.nvsu"));
        assert_eq!(again.chain(), file.chain());
        let mut first = Learnt::none(PRIOR);
        first.add(&again.chain().updates()[0]).unwrap();
        again.add(update(&first, 9)).unwrap();
        let counts = |file: &DiveFile| -> Vec<usize> {
            file.chain().updates().iter().map(|update| update.splats.len()).collect()
        };
        assert_eq!((counts(&again), counts(&open(&path))), (vec![3, 9], vec![3, 9]));
        let other = Update { before: nvsprior::prior::StateId(1), ..update(&first, 2) };
        assert!(again.add(other).is_err());
        assert_eq!(counts(&open(&path)), [3, 9]);
        let bytes = again.each_bytes().unwrap();
        assert_eq!(Update::read(&bytes[1]).unwrap(), again.chain().updates()[1]);
    }

    #[test]
    fn what_cannot_be_used_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("dive.nvsu").display().to_string();
        let wrong = |path: &str, prior| match DiveFile::open("learnt", path, prior) {
            Ok(_) => panic!("{path}"),
            Err(error) => error.to_string(),
        };
        let text = wrong(&format!("{path}/no/dive.nvsu"), PRIOR);
        assert!(text.contains("property learnt") && text.contains("folder"), "{text}");
        let mut file = open(&path);
        file.add(update(file.chain().learnt(), 3)).unwrap();
        let text = wrong(&path, PriorId(8));
        assert!(text.contains("property learnt") && text.contains("00000008"), "{text}");
        std::fs::write(&path, "junk").unwrap();
        assert!(wrong(&path, PRIOR).contains("dive.nvsu"));
    }
}
