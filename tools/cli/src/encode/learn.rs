//! `nvsprior encode --learn`: the prior learns what is new while it dives.

use std::path::Path;
use std::sync::Arc;

use anyhow::Context;
use nvsprior::learning::LearnOptions;
use nvsprior::prior::replace_file;
use nvsprior::render::Scene;
use nvsprior::{Encoder, Engine};
use nvsprior_inputs::args::PriorArgs;

/// Whether to learn, and how.
#[derive(clap::Args)]
pub struct LearnArgs {
    /// Learn what frames show and the prior does not: it becomes updates of the prior, NAME.nvsu beside the packet of
    /// the frame after which it is used
    #[arg(long)]
    learn: bool,
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
    /// Uploads the prior, with room for updates if they are wanted.
    pub fn upload(&self, prior: &PriorArgs, engine: &Engine) -> anyhow::Result<Arc<Scene>> {
        if !self.learn {
            return prior.upload(engine);
        }
        engine
            .upload_for_updates(&prior.open()?)
            .with_context(|| format!("uploading {}", prior.prior.display()))
    }

    /// Has an encoder learn, if that is wanted.
    pub fn begin(&self, encoder: &mut Encoder) -> anyhow::Result<()> {
        if !self.learn {
            return Ok(());
        }
        let (steps_per_frame, horizon) = (self.learn_steps, self.learn_horizon);
        let options = LearnOptions { steps_per_frame, horizon, ..LearnOptions::default() };
        Ok(encoder.learn(&options)?)
    }

    /// Writes the update that the last frame proved, beside its packet, and adopts it. Returns its bytes; 0: there is
    /// none.
    pub fn write_update(&self, encoder: &mut Encoder, packet: &Path) -> anyhow::Result<usize> {
        let Some(update) = encoder.take_update()? else { return Ok(0) };
        replace_file(&packet.with_extension("nvsu"), &update)?;
        if let Some(number) = encoder.waiting_update() {
            encoder.adopt(number);
        }
        Ok(update.len())
    }

    /// Says what was learnt.
    pub fn print(&self, encoder: &Encoder) {
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
}
