//! `nvsprior map --check`: reads all that a mapping run is made of, and trains nothing.

use std::path::{Path, PathBuf};

use anyhow::Context;
use nvsprior::geometry::Lens;
use nvsprior_inputs::args::{SizeArgs, progress};
use nvsprior_inputs::frame_file::{self, FrameFileError};
use nvsprior_inputs::posed::PosedInput;
use nvsprior_inputs::report::row;
use nvsprior_inputs::structure;
use nvsprior_inputs::video::{Ended, FrameSize, Video};
use rayon::prelude::*;

use super::Args;
use super::video::Given;
use crate::inspect::describe_lens;

/// Width that pictures are reduced to: all of their pixels are read.
const WIDTH: u32 = 64;
/// Pictures that are named if they cannot be used.
const NAMED: usize = 20;

/// Prints what is read, what counts of it, and what cannot be used.
///
/// # Errors
/// If anything cannot be used.
pub fn run(args: &Args) -> anyhow::Result<()> {
    match args.video.check(args.structure.unposed())? {
        Given::Nothing => posed(args),
        Given::Folder(folder) => unposed(&folder, args),
        Given::Videos(videos) => videos.iter().try_for_each(|path| video(path, args)),
    }
}

/// Pictures with poses.
fn posed(args: &Args) -> anyhow::Result<()> {
    let listed = args.inputs.list(None, None)?;
    row(
        "pictures",
        format!("{} to train on, {} held out", listed.train.len(), listed.held_out.len()),
    );
    row("points", listed.points.len().to_string());
    let held_out = listed.held_out.iter().map(|(_, input)| input);
    let inputs: Vec<&PosedInput> = listed.train.iter().chain(held_out).collect();
    let mut lenses: Vec<&Lens> = Vec::new();
    for input in &inputs {
        if !lenses.contains(&&input.lens) {
            lenses.push(&input.lens);
        }
    }
    for lens in &lenses {
        row("lens", describe_lens(Some(lens)));
    }
    let read = |input: &&PosedInput| {
        let camera = SizeArgs::of(WIDTH).reduced(&input.lens.pinhole());
        let (_, counts) = input.load_masked(&camera).map_err(|error| error.to_string())?;
        Ok(counts.data.contains(&false))
    };
    summed(inputs.par_iter(), read)
}

/// Pictures whose poses COLMAP will find.
fn unposed(folder: &Path, args: &Args) -> anyhow::Result<()> {
    let files = structure::pictures(folder, args.structure.lenses())?;
    row("pictures", format!("{}, without poses", files.len()));
    let read = |file: &PathBuf| match frame_file::is_opaque(file) {
        Ok(opaque) => Ok(!opaque),
        Err(error) => Err(FrameFileError::to_string(&error)),
    };
    summed(files.par_iter(), read)
}

/// Reads all of them. `read`: whether parts of one do not count, or why it cannot be used.
fn summed<'a, T: 'a + Sync>(
    all: rayon::slice::Iter<'a, T>,
    read: impl Fn(&T) -> Result<bool, String> + Sync + Send,
) -> anyhow::Result<()> {
    let bar = progress(all.len(), "pictures");
    let read = |one| {
        let found = read(one);
        bar.inc(1);
        found
    };
    let found: Vec<Result<bool, String>> = all.map(read).collect();
    bar.finish_and_clear();
    let in_part = found.iter().filter(|found| **found == Ok(true)).count();
    row("masked", format!("{in_part}: parts of them do not count (mask, alpha, beyond the lens)"));
    let wrong: Vec<&String> = found.iter().filter_map(|found| found.as_ref().err()).collect();
    wrong.iter().take(NAMED).for_each(|what| row("refused", (*what).clone()));
    anyhow::ensure!(wrong.is_empty(), "{} of {} pictures cannot be used", wrong.len(), found.len());
    row("refused", "none".into());
    Ok(())
}

/// All frames of a video.
fn video(path: &Path, args: &Args) -> anyhow::Result<()> {
    let video = Video::open(path, args.video.decoder())?;
    let (width, height) = (video.header.width, video.header.height);
    row("video", format!("{}: {width}×{height}, {}", path.display(), video.codec));
    let bar = progress(video.frames.unwrap_or_default() as usize, "frames");
    let mut reader = video.read(FrameSize::AtMost(WIDTH))?;
    let (mut frames, mut first, mut last) = (0_usize, None, 0.0);
    while let Some(frame) = reader.next_frame()? {
        first.get_or_insert(frame.time);
        (frames, last) = (frames + 1, frame.time);
        bar.inc(1);
    }
    bar.finish_and_clear();
    let first = first.with_context(|| format!("{}: no frame", path.display()))?;
    row("frames", format!("{frames}, from {first:.3} s to {last:.3} s"));
    match reader.ended() {
        Some(Ended::CutOff(said)) => anyhow::bail!("{}: is cut off: {said}", path.display()),
        _ => Ok(()),
    }
}
