//! The frames of a mapping run, each with the prior's render: what coder tables and filters learn from.

use std::path::PathBuf;

use nvsprior::{Encoder, EncoderOptions, Prior};
use nvsprior_inputs::args::{DeviceArgs, SizeArgs, progress};
use nvsprior_inputs::input::{Input, InputArgs};
use nvsprior_train::coder_tables::Pair;

use crate::row;

#[derive(clap::Args)]
pub struct MappingRunArgs {
    /// cameras.json, or nerfstudio's transforms.json: the mapping run, with poses
    #[arg(long, value_name = "FILE")]
    cameras: PathBuf,
    /// Only the frames of this split of the camera file
    #[arg(long, value_name = "NAME")]
    split: Option<String>,
    #[command(flatten)]
    size: SizeArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

impl MappingRunArgs {
    /// Finds the pose of each frame, starting from the one in the camera file, and draws the prior there. Every eighth
    /// frame with a certain pose is held out.
    pub fn pairs(&self, prior: &Prior) -> anyhow::Result<MappingRun> {
        MappingRun::of(self, prior)
    }
}

/// The frames of a mapping run with their renders.
pub struct MappingRun {
    frames: usize,
    /// To learn from.
    pub learned: Vec<Pair>,
    /// To measure on.
    pub held_out: Vec<Pair>,
}

impl MappingRun {
    fn of(args: &MappingRunArgs, prior: &Prior) -> anyhow::Result<MappingRun> {
        /// One frame in this many is held out.
        const HELD_OUT: usize = 8;
        let frames = inputs(args)?;
        let pairs = pairs(args, prior, &frames)?;
        let certain = pairs.len();
        let (mut learned, mut held_out) = (Vec::new(), Vec::new());
        for (index, pair) in pairs.into_iter().enumerate() {
            let to = if index % HELD_OUT == 0 { &mut held_out } else { &mut learned };
            to.push(pair);
        }
        anyhow::ensure!(
            !learned.is_empty(),
            "{}: {certain} of {} frames have a certain pose, two are needed: are the poses in the prior's frame?",
            args.cameras.display(),
            frames.len()
        );
        Ok(MappingRun { frames: frames.len(), learned, held_out })
    }

    /// Prints how many frames there are.
    pub fn print(&self) {
        let (learned, held_out) = (self.learned.len(), self.held_out.len());
        let certain = learned + held_out;
        let text = format!(
            "{}, {certain} certain: {learned} learned from, {held_out} held out",
            self.frames
        );
        row("frames", text);
    }
}

/// The frames of the run; each starts from its pose in the camera file.
fn inputs(args: &MappingRunArgs) -> anyhow::Result<Vec<Input>> {
    let input = InputArgs {
        cameras: args.cameras.clone(),
        split: args.split.clone(),
        limit: None,
        size: args.size.clone(),
        start_offset: None,
        starts: "camera-file".into(),
    };
    input.frames()
}

/// The frames with a certain pose, each with the prior's render at it.
fn pairs(args: &MappingRunArgs, prior: &Prior, frames: &[Input]) -> anyhow::Result<Vec<Pair>> {
    let engine = args.device.open()?;
    let scene = engine.upload(prior)?;
    let options = EncoderOptions { rate: None, ..EncoderOptions::default() };
    let mut encoder = Encoder::new(&engine, &scene, &frames[0].camera, options)?;
    let bar = progress(frames.len(), "finding poses");
    let mut pairs = Vec::new();
    for frame in frames {
        let (picture, encoded) = frame.encode(&mut encoder, &frame.read()?)?;
        // A wrong pose would teach what no difference picture looks like.
        if encoded.stats.certain {
            pairs.push(Pair { frame: picture, render: encoded.render });
        }
        bar.inc(1);
    }
    args.device.check(&engine)?;
    Ok(pairs)
}
