//! `nvsprior map VIDEO...`: frames of videos become the pictures.

use std::path::{Path, PathBuf};

use nvsprior_inputs::values::{self, WrongUsage};
use nvsprior_inputs::video::{ChoiceOptions, DecoderChoice, Record, frames_for_mapping};

use super::saved::beside;
use super::shown::Shown;
use super::structure::{Search, Unposed};

/// Which frames of a video.
#[derive(clap::Args)]
#[command(next_help_heading = "Videos")]
pub struct VideoArgs {
    /// How much of the picture a frame has in common with the one taken before, about: 10 % more or less. Poses are
    /// found on these; more frames are taken for the training
    #[arg(long, value_name = "PERCENT", conflicts_with = "cameras", default_value_t = 70,
        value_parser = clap::value_parser!(u8).range(20..=90))]
    overlap: u8,
    /// Take at most so many frames of the videos; then neighbours overlap less
    #[arg(long, value_name = "N", conflicts_with = "cameras", value_parser = values::count)]
    frames: Option<usize>,
    /// The program that decodes videos
    #[arg(long, value_name = "WHICH", conflicts_with = "cameras", default_value = "auto")]
    decoder: DecoderChoice,
}

/// What was given of pictures without poses.
pub enum Given {
    Nothing,
    Folder(PathBuf),
    Videos(Vec<PathBuf>),
}

impl VideoArgs {
    pub fn decoder(&self) -> DecoderChoice {
        self.decoder
    }

    /// Tells folders from videos, and finds out whether they are there.
    pub fn check(&self, paths: &[PathBuf]) -> anyhow::Result<Given> {
        if let Some(path) = paths.iter().find(|path| !path.exists()) {
            anyhow::bail!("{}: neither a folder of pictures nor a video is there", path.display());
        }
        let given = match paths {
            [] => Given::Nothing,
            [folder] if folder.is_dir() => Given::Folder(folder.clone()),
            videos if videos.iter().any(|path| path.is_dir()) => {
                let what = "give one folder of pictures, or one or more videos";
                return Err(WrongUsage(format!("PICTURES: {what}")).into());
            }
            videos => Given::Videos(videos.to_vec()),
        };
        match (&given, self.frames) {
            (Given::Videos(_), Some(0 | 1)) => {
                Err(WrongUsage("--frames: poses are found from at least two".into()).into())
            }
            (Given::Folder(_), Some(_)) => {
                Err(WrongUsage("--frames is for videos; all pictures of a folder are used".into())
                    .into())
            }
            _ => Ok(given),
        }
    }

    /// The folder of pictures; of videos, after their frames were chosen into one beside the prior.
    pub fn pictures(&self, given: Given, how: &Search) -> anyhow::Result<Option<Unposed>> {
        let videos = match given {
            Given::Nothing => return Ok(None),
            Given::Folder(folder) => {
                return Ok(Some(Unposed { folder, sequence: false, first: Vec::new() }));
            }
            Given::Videos(videos) => videos,
        };
        let folder = beside(how.out, ".frames");
        let overlap = f64::from(self.overlap) / 100.0;
        let options = ChoiceOptions {
            decoder: self.decoder,
            overlap,
            most: self.frames,
            matched: how.matched(),
        };
        let mut shown = Shown::default();
        let record =
            frames_for_mapping(&videos, &folder, &options, &mut |progress| shown.show(progress))?;
        describe(&record, &folder, shown.worked());
        let first = record.frames.into_iter().filter(|frame| frame.first);
        Ok(Some(Unposed { folder, sequence: true, first: first.map(|frame| frame.file).collect() }))
    }
}

fn describe(record: &Record, folder: &Path, worked: bool) {
    let read: usize = record.videos.iter().map(|video| video.frames).sum();
    let first = record.frames.iter().filter(|frame| frame.first).count();
    let before = if worked { "" } else { " (chosen before)" };
    let overlaps: Vec<f64> = record.frames.iter().filter_map(|frame| frame.overlap).collect();
    let mean = 100.0 * overlaps.iter().sum::<f64>() / overlaps.len().max(1) as f64;
    tell!(
        "{} of {read} frames are in {}{before}, {first} of them for finding poses; neighbours have {mean:.0} % in \
         common on average",
        record.frames.len(),
        folder.display()
    );
}
