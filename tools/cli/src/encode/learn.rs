//! `nvsprior encode --learn`: the prior learns what is new while it dives.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use nvsprior::learning::LearnOptions;
use nvsprior::prior::update::DIVE_FILE;
use nvsprior::prior::{Update, replace_file};
use nvsprior::render::Scene;
use nvsprior::{Encoder, Engine};
use nvsprior_inputs::args::PriorArgs;
use nvsprior_inputs::input::Input;

use crate::keyed_files::FileTags;
use crate::updates::DiveFile;

/// Whether to learn, and how.
#[derive(clap::Args)]
pub struct LearnArgs {
    /// Learn what frames show and the prior does not: it becomes updates of the prior, NAME.nvsu beside the packet of
    /// the frame after which it is used. All of them are kept in dive.nvsu
    #[arg(long)]
    learn: bool,
    /// Go on from the updates of earlier dives: their dive.nvsu
    #[arg(long, value_name = "FILE")]
    learnt: Option<PathBuf>,
    /// Steps of training per frame; each takes about as long as a forward render
    #[arg(long, value_name = "N", default_value_t = LearnOptions::default().steps_per_frame, requires = "learn",
        value_parser = clap::value_parser!(u32).range(1..=1000))]
    learn_steps: u32,
    /// An update must save the bytes that it takes while the camera moves by so many key frames: from one to the next,
    /// points at the picture's median depth move by four pixels
    #[arg(long, value_name = "N", default_value_t = LearnOptions::default().horizon, requires = "learn")]
    learn_horizon: u32,
}

impl LearnArgs {
    fn is_wanted(&self) -> bool {
        self.learn || self.learnt.is_some()
    }

    /// Refuses a frame whose update would have the name of the dive file.
    pub fn check(&self, frames: &[Input]) -> anyhow::Result<()> {
        let taken = |frame: &&Input| {
            Path::new(&frame.name).with_added_extension("nvsu") == Path::new(DIVE_FILE)
        };
        match frames.iter().find(taken).filter(|_| self.is_wanted()) {
            Some(frame) => anyhow::bail!(
                "{}: a frame of this name takes the place of {DIVE_FILE}, which keeps what is learnt; rename it",
                frame.file
            ),
            None => Ok(()),
        }
    }

    /// Uploads the prior, with room for updates if they are wanted.
    pub fn upload(&self, prior: &PriorArgs, engine: &Engine) -> anyhow::Result<Arc<Scene>> {
        if !self.is_wanted() {
            return prior.upload(engine);
        }
        prior.upload_for_updates(engine)
    }

    /// Has an encoder draw what was learnt, and learn, if that is wanted. Returns the dive file then.
    pub fn begin(&self, encoder: &mut Encoder, packets: &Path) -> anyhow::Result<Option<DiveFile>> {
        if !self.is_wanted() {
            return Ok(None);
        }
        let mut dive_file = DiveFile::new(packets, encoder.learnt().prior(), self.learnt.as_ref())?;
        if !dive_file.updates().is_empty() {
            encoder.set_learnt(dive_file.learnt())?;
            dive_file.save()?;
        }
        if self.learn {
            let (steps_per_frame, horizon) = (self.learn_steps, self.learn_horizon);
            encoder.learn(&LearnOptions { steps_per_frame, horizon, ..LearnOptions::default() })?;
        }
        Ok(Some(dive_file))
    }
}

/// Learns from the last frame. Writes the update that it proves beside its packet, keeps it and adopts it. Returns its
/// bytes; 0: there is none.
pub fn learn_more(
    encoder: &mut Encoder,
    dive_file: Option<&mut DiveFile>,
    tags: &mut FileTags,
    packet: &Path,
) -> anyhow::Result<usize> {
    let Some(dive_file) = dive_file else { return Ok(0) };
    encoder.learn_more(1.0)?;
    let Some(update) = encoder.take_update() else { return Ok(0) };
    replace_file(&packet.with_extension("nvsu"), tags.put(&update))?;
    dive_file.add(Update::read(&update)?)?;
    if let Some(number) = encoder.waiting_update() {
        encoder.adopt(number);
    }
    Ok(update.len())
}

/// Says what was learnt.
pub fn print(encoder: &Encoder) {
    if let Some(stats) = encoder.learner_stats() {
        println!(
            "learnt: {} splats in {} updates of {} bytes; {} drafts did not pay; state {}",
            stats.splats,
            stats.updates,
            stats.update_bytes,
            stats.refused,
            encoder.learnt().state()
        );
    }
}
