//! Pictures without poses: COLMAP finds these first.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::ValueEnum;
use indicatif::ProgressBar;
use nvsprior_inputs::args::progress;
use nvsprior_inputs::posed::PosedPictures;
use nvsprior_inputs::structure::{
    DEPTH, Lenses, Matching, Progress, Step, Structure, StructureOptions, find_poses,
};

use super::video::Unposed;

/// Which pictures to find poses of, and how.
#[derive(clap::Args)]
#[command(next_help_heading = "Pictures without poses (by COLMAP)")]
pub struct StructureArgs {
    /// Pictures without poses: a folder of them, or video files, of which frames are chosen into the folder
    /// OUT.frames. COLMAP finds the poses, in the folder OUT.colmap. Both folders are kept: what is finished there is
    /// not done again
    #[arg(value_name = "PICTURES", id = "unposed")]
    unposed: Vec<PathBuf>,
    /// COLMAP's camera model [default: OPENCV]
    #[arg(long, value_name = "MODEL", conflicts_with = "cameras", value_parser = MODELS)]
    camera_model: Option<String>,
    /// The camera model's parameters with commas between, in COLMAP's order (of OPENCV fx,fy,cx,cy,k1,k2,p1,p2), if the
    /// camera was calibrated; they are kept as they are
    #[arg(long, value_name = "NUMBERS", conflicts_with = "cameras", requires = "camera_model",
        value_parser = camera_params)]
    camera_params: Option<String>,
    /// Which pictures share intrinsics [default: one, that is, all]
    #[arg(long, value_name = "WHICH", conflicts_with = "cameras")]
    lenses: Option<LensesArg>,
    /// Which pairs of pictures are compared: all, those near each other by name (the order of time), or `auto`: all of
    /// up to 250 pictures, else those near each other [default: auto]
    #[arg(long, value_name = "WHICH", conflicts_with = "cameras")]
    matching: Option<MatchingArg>,
    /// A vocabulary tree of COLMAP's: with it, sequential matching also finds places seen before
    #[arg(long, value_name = "FILE", conflicts_with = "cameras")]
    vocabulary: Option<PathBuf>,
}

/// Camera models of which pictures can be undistorted.
const MODELS: [&str; 6] =
    ["SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE"];

/// Finite numbers with commas between, as COLMAP wants them. It checks that they are as many as the model has.
fn camera_params(text: &str) -> Result<String, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|v| v.trim().parse()).collect();
    let numbers = numbers.map_err(|e| format!("{e}"))?;
    match numbers.iter().all(|v| v.is_finite()) {
        true => Ok(numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(",")),
        false => Err("all numbers must be finite".into()),
    }
}

#[derive(Clone, Copy, ValueEnum)]
enum LensesArg {
    One,
    Folder,
    Picture,
}

#[derive(Clone, Copy, ValueEnum)]
enum MatchingArg {
    Auto,
    Exhaustive,
    Sequential,
}

impl StructureArgs {
    /// The pictures or videos that were given.
    pub fn unposed(&self) -> &[PathBuf] {
        &self.unposed
    }

    /// Finds the poses of pictures, if there are any without. COLMAP works beside `out`.
    pub fn find(
        &self,
        pictures: Option<&Unposed>,
        out: &Path,
        masks: Option<&Path>,
    ) -> anyhow::Result<Option<PosedPictures>> {
        let Some(pictures) = pictures else { return Ok(None) };
        if let Some(tree) = self.vocabulary.as_ref().filter(|tree| !tree.is_file()) {
            anyhow::bail!("{}: no such file", tree.display());
        }
        let mut shown = Shown::default();
        let found = find_poses(
            &pictures.folder,
            &work_folder(out),
            &self.options(pictures, masks),
            &mut |progress| shown.show(progress),
        )?;
        describe(&found);
        Ok(Some(found.posed))
    }

    fn options(&self, pictures: &Unposed, masks: Option<&Path>) -> StructureOptions {
        StructureOptions {
            sequence: pictures.sequence,
            camera_model: self.camera_model.clone().unwrap_or_else(|| "OPENCV".into()),
            camera_params: self.camera_params.clone(),
            lenses: match self.lenses {
                None | Some(LensesArg::One) => Lenses::One,
                Some(LensesArg::Folder) => Lenses::Folder,
                Some(LensesArg::Picture) => Lenses::Picture,
            },
            matching: match self.matching {
                None | Some(MatchingArg::Auto) => Matching::Auto,
                Some(MatchingArg::Exhaustive) => Matching::Exhaustive,
                Some(MatchingArg::Sequential) => Matching::Sequential,
            },
            vocabulary: self.vocabulary.clone(),
            masks: masks.map(Path::to_path_buf),
        }
    }
}

fn work_folder(out: &Path) -> PathBuf {
    let mut name = out.file_name().unwrap_or_default().to_owned();
    name.push(".colmap");
    out.with_file_name(name)
}

const BAR: f64 = 1000.0;

/// The steps on standard error: a line each, and a bar while one runs.
#[derive(Default)]
struct Shown {
    running: Option<(Instant, ProgressBar)>,
}

impl Shown {
    fn show(&mut self, progress: Progress) {
        match progress {
            Progress::Begins(step) => {
                eprintln!("COLMAP: {} …", step.name());
                self.running = Some((Instant::now(), bar(step)));
            }
            Progress::WasDone(step) => eprintln!("COLMAP: {}: done before", step.name()),
            Progress::At(share) => {
                if let Some((_, bar)) = &self.running {
                    bar.set_position((share * BAR) as u64);
                }
            }
            Progress::Ends(step) => {
                if let Some((start, bar)) = self.running.take() {
                    bar.finish_and_clear();
                    let seconds = start.elapsed().as_secs();
                    eprintln!("COLMAP: {}: done in {seconds} s", step.name());
                }
            }
        }
    }
}

fn bar(step: Step) -> ProgressBar {
    progress(BAR as usize, step.name())
}

/// Names of pictures that a warning lists.
const LISTED: usize = 10;
/// Share of the pictures without a pose that deserves a warning.
const MANY: f64 = 0.2;

fn describe(found: &Structure) {
    let Structure { posed, pictures, missing, models, model, scale } = found;
    let registered = posed.inputs.len();
    eprintln!(
        "COLMAP: poses of {registered} of {pictures} pictures; {} multiplied by {scale:.4}, so that the median depth \
            of \
         the scene is {DEPTH}",
        model.display()
    );
    if missing.is_empty() {
        return;
    }
    let listed = missing.iter().take(LISTED).cloned().collect::<Vec<_>>().join(", ");
    let others = missing.len().saturating_sub(LISTED);
    let others = if others > 0 { format!(" and {others} more") } else { String::new() };
    eprintln!("COLMAP: no pose was found of {listed}{others}; they are left out");
    if missing.len() as f64 > MANY * *pictures as f64 {
        let parts = if *models > 1 {
            format!(" COLMAP made {models} models that do not hang together; the largest is taken.")
        } else {
            String::new()
        };
        eprintln!(
            "warning: many pictures have no pose; the prior will not show what only they show.{parts} Pictures that \
             overlap more, or --matching exhaustive, may help"
        );
    }
}
