//! Finds the updates that packets need, and gives each to the decoder when it is due.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, ensure};
use nvsprior::keys::{Content, Keys};
use nvsprior::packet::Latent;
use nvsprior::prior::{Prior, Update};
use nvsprior::render::Scene;
use nvsprior::{Decoder, Engine};

use super::Args;
use crate::keyed_files::FileReader;
use crate::updates::{DiveFile, chain_of, is_chain};

/// Where updates come from.
enum Source {
    /// Each from a file of its own, once its packet is decoded.
    Files(Vec<PathBuf>),
    /// Each from a chain, once a packet is drawn with it.
    Chain(VecDeque<Update>),
}

/// The updates of a run, and what this side keeps of them.
pub struct Updates {
    source: Source,
    dive_file: DiveFile,
    reader: FileReader,
}

impl Updates {
    /// Uploads the prior, with room for updates if there are any, or if some were learnt before.
    pub fn upload(
        args: &Args,
        keys: Option<&Keys>,
        engine: &Engine,
        packets: &[PathBuf],
    ) -> anyhow::Result<(Arc<Scene>, Option<Updates>)> {
        let chain = args.updates.as_ref().filter(|path| path.is_file());
        if let Some(path) = &args.updates {
            let fits = path.is_dir() || is_chain(path)?;
            ensure!(fits, "{}: --updates takes a folder, or a dive.nvsu", path.display());
        }
        let files = if chain.is_none() { beside(args, packets) } else { Vec::new() };
        if chain.is_none() && files.is_empty() && args.learnt.is_none() {
            return Ok((args.prior.upload(engine)?, None));
        }
        args.prior.check_whole("with updates")?;
        let prior = args.prior.open()?;
        let dive_file = DiveFile::new(&args.frames, prior.id(), args.learnt.as_ref())?;
        let source = match chain {
            Some(path) => Source::Chain(after(&dive_file, &prior, path)?),
            None => Source::Files(files),
        };
        let reader = FileReader::new(keys, Content::Update);
        Ok((engine.upload_for_updates(&prior)?, Some(Updates { source, dive_file, reader })))
    }

    /// Gives a decoder what was learnt before.
    pub fn begin(&mut self, decoder: &mut Decoder) -> anyhow::Result<()> {
        for update in self.dive_file.updates() {
            decoder.add_update(&update.to_bytes()?)?;
        }
        if self.dive_file.updates().is_empty() { Ok(()) } else { self.dive_file.save() }
    }

    /// Gives the decoder those updates of a chain that a packet is drawn with.
    pub fn before(&mut self, decoder: &mut Decoder, packet: &[u8]) -> anyhow::Result<()> {
        let Source::Chain(rest) = &self.source else { return Ok(()) };
        // What cannot be read is named when it is decoded.
        let Some(update) = Latent::decode(packet).ok().and_then(|latent| latent.update) else {
            return Ok(());
        };
        let ahead = update.wrapping_sub(self.dive_file.learnt().number() as u8);
        // A number that lies behind is that of a late packet.
        let due = if ahead <= LATE { usize::from(ahead).min(rest.len()) } else { 0 };
        self.take(decoder, due)
    }

    /// Gives the decoder the update that was sent after a packet, if it has a file of its own.
    pub fn after(&mut self, decoder: &mut Decoder, packet: &Path) -> anyhow::Result<()> {
        let Source::Files(files) = &self.source else { return Ok(()) };
        let stem = packet.file_stem();
        let Some(path) = files.iter().find(|path| path.file_stem() == stem) else { return Ok(()) };
        let named = || path.display().to_string();
        let bytes = self.reader.read(path).with_context(named)?;
        decoder.add_update(&bytes).with_context(named)?;
        self.dive_file.add(Update::read(&bytes)?)
    }

    /// Keeps those updates of a chain, too, that no packet needed.
    pub fn finish(&mut self, decoder: &mut Decoder) -> anyhow::Result<()> {
        let left = match &self.source {
            Source::Chain(rest) => rest.len(),
            Source::Files(_) => 0,
        };
        self.take(decoder, left)
    }

    /// Gives the decoder the next updates of a chain.
    fn take(&mut self, decoder: &mut Decoder, count: usize) -> anyhow::Result<()> {
        let Source::Chain(rest) = &mut self.source else { return Ok(()) };
        for update in rest.drain(..count) {
            decoder.add_update(&update.to_bytes()?)?;
            self.dive_file.add(update)?;
        }
        Ok(())
    }
}

/// Updates whose numbers lie farther ahead than this, modulo 256, lie behind.
const LATE: u8 = 127;

/// The updates beside the packets, or in the folder that was given.
fn beside(args: &Args, packets: &[PathBuf]) -> Vec<PathBuf> {
    let folder = args.updates.as_ref().unwrap_or(&args.packets);
    let path = |packet: &PathBuf| {
        let name = packet.with_extension("nvsu").file_name().map(|name| folder.join(name));
        name.filter(|path| path.exists())
    };
    packets.iter().filter_map(path).collect()
}

/// The updates in a file that come after those in the dive file.
fn after(dive_file: &DiveFile, prior: &Prior, path: &PathBuf) -> anyhow::Result<VecDeque<Update>> {
    let chain = chain_of(prior.id(), std::slice::from_ref(path))?;
    let count = dive_file.updates().len().min(chain.updates().len());
    ensure!(
        chain.updates()[..count] == dive_file.updates()[..count],
        "{}: of another chain than --learnt; both must be of the same dives",
        path.display()
    );
    Ok(chain.updates()[count..].iter().cloned().collect())
}
