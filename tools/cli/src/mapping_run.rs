//! The frames of a mapping run, each with the prior's render: what coder tables and filters learn from.

use std::path::{Path, PathBuf};

use nvsprior::{Encoder, EncoderOptions, Prior};
use nvsprior_inputs::args::{DeviceArgs, SizeArgs, progress};
use nvsprior_inputs::input::{Input, InputArgs};
use nvsprior_train::coder_tables::Pair;

use nvsprior_inputs::report::row;

#[derive(clap::Args)]
pub struct MappingRunArgs {
    /// cameras.json, or nerfstudio's transforms.json: the mapping run, with poses; more files for later dives
    #[arg(long, value_name = "FILE", required = true, num_args = 1..)]
    cameras: Vec<PathBuf>,
    /// Only the frames of this split of the camera files
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
    /// To learn from, by camera file.
    pub learned: Vec<Vec<Pair>>,
    /// To measure on.
    pub held_out: Vec<Pair>,
}

impl MappingRun {
    fn of(args: &MappingRunArgs, prior: &Prior) -> anyhow::Result<MappingRun> {
        /// One frame in this many is held out.
        const HELD_OUT: usize = 8;
        let runs: Vec<Vec<Input>> =
            args.cameras.iter().map(|path| inputs(args, path)).collect::<anyhow::Result<_>>()?;
        let frames = runs.iter().map(Vec::len).sum();
        let (mut learned, mut held_out) = (Vec::new(), Vec::new());
        for pairs in pairs(args, prior, &runs)? {
            let held = |index: &usize| index.is_multiple_of(HELD_OUT);
            let (held, kept): (Vec<_>, Vec<_>) =
                pairs.into_iter().enumerate().partition(|(index, _)| held(index));
            held_out.extend(held.into_iter().map(|(_, pair)| pair));
            learned.push(kept.into_iter().map(|(_, pair)| pair).collect::<Vec<_>>());
        }
        learned.retain(|pairs| !pairs.is_empty());
        let certain = held_out.len() + learned.iter().map(Vec::len).sum::<usize>();
        anyhow::ensure!(
            !learned.is_empty(),
            "{}: {certain} of {frames} frames have a certain pose, two are needed: are the poses in the prior's frame?",
            args.cameras[0].display()
        );
        Ok(MappingRun { frames, learned, held_out })
    }

    /// Prints how many frames there are.
    pub fn print(&self) {
        let learned: usize = self.learned.iter().map(Vec::len).sum();
        let held_out = self.held_out.len();
        let certain = learned + held_out;
        let text = format!(
            "{}, {certain} certain: {learned} learned from, {held_out} held out",
            self.frames
        );
        row("frames", text);
    }
}

/// The frames of a run; each starts from its pose in the camera file.
fn inputs(args: &MappingRunArgs, cameras: &Path) -> anyhow::Result<Vec<Input>> {
    let input = InputArgs {
        cameras: Some(cameras.to_owned()),
        split: args.split.clone(),
        limit: None,
        size: args.size.clone(),
        starts: "camera-file".into(),
    };
    input.frames()
}

/// The frames with a certain pose, each with the prior's render at it; by run.
fn pairs(
    args: &MappingRunArgs,
    prior: &Prior,
    runs: &[Vec<Input>],
) -> anyhow::Result<Vec<Vec<Pair>>> {
    let engine = args.device.open()?;
    let scene = engine.upload(prior)?;
    let bar = progress(runs.iter().map(Vec::len).sum(), "finding poses");
    let mut all = Vec::new();
    for frames in runs {
        let mut pairs = Vec::new();
        let options = EncoderOptions { rate: None, ..EncoderOptions::default() };
        let mut encoder = Encoder::new(&engine, &scene, &frames[0].camera, options)?;
        for frame in frames {
            let (picture, encoded) = frame.encode(&mut encoder, &frame.read()?)?;
            // A wrong pose would teach what no difference picture looks like.
            if encoded.stats.certain {
                pairs.push(Pair { frame: picture, render: encoded.render });
            }
            bar.inc(1);
        }
        all.push(pairs);
    }
    args.device.check(&engine)?;
    Ok(all)
}
