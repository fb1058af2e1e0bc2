//! Files of updates: single ones, and the chain that a side keeps of its dives.

use std::path::{Path, PathBuf};

use anyhow::Context;
use nvsprior::prior::update::{CHAIN_MAGIC, DIVE_FILE};
use nvsprior::prior::{Learnt, Update, UpdateChain};
use nvsprior::{Prior, PriorId};

/// Whether a file begins as a chain of updates does.
pub fn is_chain(path: &Path) -> anyhow::Result<bool> {
    Ok(Prior::read_file(path)?.starts_with(CHAIN_MAGIC))
}

/// The updates in a file. Says so if some are left out.
fn read(path: &Path) -> anyhow::Result<Vec<Update>> {
    if !is_chain(path)? {
        return Ok(vec![Update::open(path)?]);
    }
    let read = UpdateChain::open(path)?;
    if let Some(error) = read.left_out {
        eprintln!("{error}");
    }
    Ok(read.chain.updates().to_vec())
}

/// The updates in some files, in the order of their numbers, as the chain of a prior.
pub fn chain_of(prior: PriorId, paths: &[PathBuf]) -> anyhow::Result<UpdateChain> {
    let mut updates = Vec::new();
    for path in paths {
        updates.extend(read(path)?.into_iter().map(|update| (update, path)));
    }
    updates.sort_by_key(|(update, _)| update.number);
    // The folder of a dive holds each update twice: by itself, and in the dive file.
    updates.dedup_by(|(update, _), (before, _)| update == before);
    let mut chain = UpdateChain::none(prior);
    for (update, path) in updates {
        chain.add(update).map_err(|error| error.in_file(path))?;
    }
    Ok(chain)
}

/// What a side keeps of its dives: a file in the folder of its packets or pictures.
pub struct DiveFile {
    path: PathBuf,
    chain: UpdateChain,
    /// An earlier dive's file lies there.
    others: bool,
}

impl DiveFile {
    /// Goes on from the updates in a file, or from none. Writes nothing yet.
    pub fn new(folder: &Path, prior: PriorId, from: Option<&PathBuf>) -> anyhow::Result<DiveFile> {
        let path = folder.join(DIVE_FILE);
        let chain = chain_of(prior, from.map_or(&[], std::slice::from_ref))?;
        let same = |from: &PathBuf| match (from.canonicalize(), path.canonicalize()) {
            (Ok(from), Ok(path)) => from == path,
            _ => false,
        };
        let others = path.exists() && !from.is_some_and(same);
        Ok(DiveFile { path, chain, others })
    }

    /// The updates so far.
    pub fn updates(&self) -> &[Update] {
        self.chain.updates()
    }

    /// What they add up to.
    pub fn learnt(&self) -> &Learnt {
        self.chain.learnt()
    }

    /// Takes an update, see [`UpdateChain::take`], and writes the file if that has changed what is kept.
    pub fn add(&mut self, update: Update) -> anyhow::Result<()> {
        if self.chain.take(update)? { self.save() } else { Ok(()) }
    }

    /// Writes the file. What an earlier dive left under its name is kept beside it.
    pub fn save(&mut self) -> anyhow::Result<()> {
        if self.others {
            let before = self.path.with_added_extension("before");
            std::fs::rename(&self.path, &before)
                .with_context(|| format!("keeping {} as {}", DIVE_FILE, before.display()))?;
            eprintln!(
                "{}: of an earlier dive; it is now {}",
                self.path.display(),
                before.display()
            );
            self.others = false;
        }
        Ok(self.chain.save(&self.path)?)
    }
}
