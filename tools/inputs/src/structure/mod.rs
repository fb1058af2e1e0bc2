//! Poses of pictures that have none, by structure from motion: the steps of COLMAP are run in a folder that is kept.
//!
//! COLMAP 3.8 (Debian's) and later ones are run, on the CPU. Options that were renamed are told by each step's help.

mod pictures;
mod program;
mod record;
mod steps;
mod unit;

use std::path::{Path, PathBuf};

use crate::colmap::{ColmapError, ColmapModel};
use crate::posed::{PosedError, PosedOptions, PosedPictures, posed_pictures};
use pictures::Listed;
pub use program::Ended;
use program::Program;
use steps::Workplace;
pub use unit::DEPTH;

/// Which pictures share intrinsics.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lenses {
    /// All: they were taken with one camera.
    One,
    /// Those of each folder.
    Folder,
    /// None.
    Picture,
}

/// Which pairs of pictures are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Matching {
    /// All of up to [`MAX_EXHAUSTIVE`] pictures; of more, those near each other by name.
    Auto,
    /// All.
    Exhaustive,
    /// Those near each other by name, which must be the order of time.
    Sequential,
}

/// Pictures of which [`Matching::Auto`] compares all pairs. Their number grows with the square.
pub const MAX_EXHAUSTIVE: usize = 250;

#[derive(Clone, Debug)]
pub struct StructureOptions {
    /// COLMAP's name of the camera model.
    pub camera_model: String,
    /// The model's parameters in COLMAP's order, if the camera was calibrated; they are kept.
    pub camera_params: Option<String>,
    /// Which pictures share intrinsics.
    pub lenses: Lenses,
    /// Which pairs of pictures are compared.
    pub matching: Matching,
    /// The pictures are frames of a video: their names tell the order of time, and neighbours overlap.
    pub sequence: bool,
    /// A vocabulary tree of COLMAP's: with it, [`Matching::Sequential`] also finds places seen before.
    pub vocabulary: Option<PathBuf>,
    /// Folder of masks, as [`PosedOptions::masks`]. COLMAP finds those named as it names them: `a.jpg.png`.
    pub masks: Option<PathBuf>,
}

/// Pictures with the poses that were found.
#[derive(Clone, Debug)]
pub struct Structure {
    /// Pictures, poses and points, in the unit of [`DEPTH`].
    pub posed: PosedPictures,
    pub pictures: usize,
    /// Names of those whose poses were not found.
    pub missing: Vec<String>,
    /// How many models COLMAP made, of which this is the largest.
    pub models: usize,
    /// The largest model's folder, in COLMAP's own unit.
    pub model: PathBuf,
    /// What lengths in that folder are multiplied by.
    pub scale: f64,
}

/// What a running step says of itself.
#[derive(Clone, Debug, PartialEq)]
pub enum Progress {
    Begins(Step),
    /// It was finished by an earlier run.
    WasDone(Step),
    /// Share of it that is done, 0 to 1. COLMAP's mapper may begin again.
    At(f64),
    Ends(Step),
}

/// A step of the search for poses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// All pictures are read once, before hours of work.
    Check,
    /// COLMAP's `feature_extractor`.
    Features,
    /// Its `exhaustive_matcher` or `sequential_matcher`.
    Matches,
    /// Its `mapper`.
    Mapper,
}

impl Step {
    /// What it does.
    pub fn name(self) -> &'static str {
        match self {
            Step::Check => "checking pictures",
            Step::Features => "finding features",
            Step::Matches => "matching features",
            Step::Mapper => "finding poses",
        }
    }
}

#[derive(Debug, thiserror::Error)]
pub enum StructureError {
    #[error(
        "pictures without poses need the program `colmap`, which is not on the PATH; on Debian or \
        Ubuntu `apt-get install colmap`. With poses from elsewhere, give --cameras"
    )]
    NotInstalled,
    #[error("{}: {error}", path.display())]
    File { path: PathBuf, error: std::io::Error },
    #[error("{}: no pictures (PNG, JPEG, WebP) in this folder or below it", path.display())]
    Empty { path: PathBuf },
    #[error("{}: the only picture; poses are found from at least two of one scene", path.display())]
    One { path: PathBuf },
    #[error("{}: a name that is not UTF-8, or has a line break", path.display())]
    Name { path: PathBuf },
    #[error("{}: {}×{}, but {} is {}×{}: if several cameras took the pictures, put those of each in \
        a folder and give --lenses folder, or give --lenses picture", path.display(), found.0,
        found.1, first.display(), expected.0, expected.1)]
    Sizes { path: PathBuf, found: (u32, u32), first: PathBuf, expected: (u32, u32) },
    #[error("{}: holds other things than poses that were looked for before; move it, or write the \
        prior elsewhere", path.display())]
    Foreign { path: PathBuf },
    #[error("{}: another run, or a COLMAP that one left behind, is at work in it", path.display())]
    Busy { path: PathBuf },
    #[error("colmap {command} {ended}; its last words: {last}; all of them: {}", log.display())]
    Step { command: String, ended: Ended, last: String, log: PathBuf },
    #[error("COLMAP found no two pictures to begin with: they must overlap, show texture, and be \
        taken from different places; what it tried: {}", log.display())]
    NoModel { log: PathBuf },
    #[error("COLMAP found the pose of {found} picture; all that it tried: {}", log.display())]
    TooFew { found: usize, log: PathBuf },
    #[error(transparent)]
    Colmap(#[from] ColmapError),
    #[error(transparent)]
    Posed(#[from] PosedError),
}

impl StructureError {
    fn file(path: &Path) -> impl Fn(std::io::Error) -> StructureError {
        move |error| StructureError::File { path: path.to_path_buf(), error }
    }
}

/// Finds the poses of the pictures in a folder and below it. COLMAP works in the folder `work`, which is made if it is
/// not there. What an earlier run finished there with the same pictures and options is not done again.
pub fn find_poses(
    pictures: &Path,
    work: &Path,
    options: &StructureOptions,
    watch: &mut dyn FnMut(Progress),
) -> Result<Structure, StructureError> {
    let program = Program::find()?;
    let listed = Listed::of(pictures, options.lenses)?;
    let mut workplace = Workplace::open(work)?;
    workplace.run(&program, &listed, options, watch)?;
    let log = workplace.log();
    let (model, models) = largest(&workplace.sparse())?.ok_or(StructureError::NoModel { log })?;
    let posed = posed_pictures(
        &model,
        &PosedOptions {
            pictures: Some(listed.folder),
            masks: options.masks.clone(),
            ..PosedOptions::default()
        },
    )?;
    if posed.inputs.len() < 2 {
        let (found, log) = (posed.inputs.len(), workplace.log());
        return Err(StructureError::TooFew { found, log });
    }
    let found: std::collections::HashSet<_> =
        posed.inputs.iter().map(|i| i.name.as_str()).collect();
    let missing = listed.names.iter().filter(|name| !found.contains(name.as_str()));
    let (missing, pictures) = (missing.cloned().collect(), listed.names.len());
    let (posed, scale) = unit::scaled(posed);
    Ok(Structure { posed, pictures, missing, models, model, scale })
}

/// The folder of the model with most pictures, and how many models there are.
fn largest(sparse: &Path) -> Result<Option<(PathBuf, usize)>, StructureError> {
    let mut models = Vec::new();
    for entry in std::fs::read_dir(sparse).map_err(StructureError::file(sparse))? {
        let folder = entry.map_err(StructureError::file(sparse))?.path();
        if ColmapModel::is_in(&folder) {
            let pictures = ColmapModel::open(&folder)?.views.len();
            models.push((std::cmp::Reverse(pictures), folder));
        }
    }
    models.sort();
    let count = models.len();
    Ok(models.into_iter().next().map(|(_, folder)| (folder, count)))
}
