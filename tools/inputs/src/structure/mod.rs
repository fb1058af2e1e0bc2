//! Poses of pictures that have none, by structure from motion: the steps of COLMAP are run in a folder that is kept.
//!
//! COLMAP 4, or pycolmap by the same command line, solves for all poses at once. COLMAP 3.8 (Debian's) and later ones
//! are run as well. All run on the CPU. Options that were renamed are told by each step's help.

mod finding;
mod judge;
mod missing;
mod pairs;
mod pictures;
mod program;
mod record;
mod round;
mod steps;
mod unit;

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

use crate::colmap::{ColmapError, ColmapModel};
use crate::locked_folder::FolderError;
use crate::navigation::{Alignment, NavigationError, StatedCourse, align};
use crate::posed::{PosedError, PosedPictures, pictures_of_model};
use crate::progress::{Progress, Watch};
use crate::video::{VideoError, frame_times};
pub use finding::Finder;
pub use judge::Doubtful;
use pictures::Listed;
pub use program::Ended;
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
    /// Those near each other by name, which is the order of time, and those that show the same place. Few pictures are
    /// all compared.
    Auto,
    /// All. Their number grows with the square.
    Exhaustive,
    /// Those near each other by name.
    Sequential,
}

#[derive(Clone, Debug)]
pub struct StructureOptions {
    /// Which program finds poses.
    pub finder: Finder,
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
    /// Longest side to which pictures are reduced for matching, pixels.
    pub size: u32,
    /// Folder of masks, as [`PosedOptions::masks`]. COLMAP finds those named as it names them: `a.jpg.png`.
    pub masks: Option<PathBuf>,
    /// What the vehicle states of its course: it gives the unit and the vertical.
    pub navigation: Option<Navigation>,
    /// Seed of all that is random.
    pub seed: u64,
}

/// A stated course, and what joins it to pictures.
#[derive(Clone, Debug)]
pub struct Navigation {
    pub path: PathBuf,
    pub course: StatedCourse,
    /// Times of pictures in their video, by name, seconds.
    pub times: HashMap<String, f64>,
    /// How far the camera looks up if the vehicle is level, radians.
    pub tilt: f64,
}

impl Navigation {
    /// With the times of pictures that are frames of one video, as `frames.json` beside them tells.
    pub fn with_times(self, pictures: &Path) -> Result<Navigation, StructureError> {
        let times = frame_times(pictures)?;
        if times.is_empty() && self.course.is_by_time() {
            return Err(NavigationError::NoTimes { path: self.path }.into());
        }
        Ok(Navigation { times, ..self })
    }

    fn align(&self, posed: &mut PosedPictures) -> Result<Alignment, NavigationError> {
        let stated = |name: &str| self.course.of(name, self.times.get(name).copied());
        let stated: Vec<_> = posed.inputs.iter().map(|input| stated(&input.name)).collect();
        align(posed, &stated, self.tilt, &self.path)
    }
}

/// Pictures with the poses that were found.
#[derive(Clone, Debug)]
pub struct Structure {
    /// Pictures, poses and points, in the unit of [`DEPTH`], or as [`Alignment`] says.
    pub posed: PosedPictures,
    /// How they fit to what the vehicle states.
    pub alignment: Option<Alignment>,
    pub pictures: usize,
    /// Names of those whose poses were not found.
    pub missing: Vec<String>,
    /// Mean over the points of their reprojection error, pixels of the pictures as they are.
    pub reprojection_error: Option<f64>,
    /// What gives reason to doubt the poses.
    pub doubtful: Vec<Doubtful>,
    /// How long the search took, all steps of all runs that were not cut off, seconds.
    pub seconds: f64,
    /// The largest piece's folder, in COLMAP's own unit.
    pub model: PathBuf,
    /// What lengths in that folder are multiplied by.
    pub scale: f64,
}

/// A step of the search for poses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ColmapStep {
    /// All pictures are read once, before hours of work.
    Check,
    /// COLMAP's `feature_extractor`.
    Features,
    /// Its `matches_importer`.
    Matches,
    /// Its `global_mapper`, or `mapper`.
    Mapper,
}

impl ColmapStep {
    /// What it does.
    fn name(self) -> String {
        let name = match self {
            ColmapStep::Check => "checking pictures",
            ColmapStep::Features => "finding features",
            ColmapStep::Matches => "matching features",
            ColmapStep::Mapper => "finding poses",
        };
        name.to_owned()
    }
}

#[derive(Debug, thiserror::Error)]
pub enum StructureError {
    #[error(
        "pictures without poses need COLMAP 4 or the Python package pycolmap ({why}); install COLMAP 4, or Python 3 \
         with venv and a network, or name a program with --poses. Debian's colmap works too, but takes hours for some \
         hundred pictures. With poses from elsewhere, give --cameras"
    )]
    NotInstalled { why: String },
    #[error("{}: neither a COLMAP nor a Python with pycolmap", path.display())]
    NoColmap { path: PathBuf },
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
    #[error("{program} {command} {ended}; its last words: {last}; all of them: {}", log.display())]
    ColmapStep { program: &'static str, command: String, ended: Ended, last: String, log: PathBuf },
    #[error("{program} found no two pictures to begin with: they must be sharp, overlap, show texture, and be taken \
        from different places; what it tried: {}", log.display())]
    NoModel { program: &'static str, log: PathBuf },
    #[error("{program} found the pose of {found} picture; all that it tried: {}", log.display())]
    TooFew { program: &'static str, found: usize, log: PathBuf },
    #[error(transparent)]
    Folder(#[from] FolderError),
    #[error(transparent)]
    Colmap(#[from] ColmapError),
    #[error(transparent)]
    Posed(#[from] PosedError),
    #[error(transparent)]
    Navigation(#[from] NavigationError),
    #[error(transparent)]
    Video(#[from] VideoError),
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
    watch: Watch,
) -> Result<Structure, StructureError> {
    let listed = Listed::of(pictures, options.lenses)?;
    let mut workplace = Workplace::open(work)?;
    let program = options.finder.find(watch)?;
    watch(Progress::Says(format!("poses are found by {}", program.version())));
    if !program.is_global() {
        let slow = "this COLMAP is older than 4 and finds one pose after the other: some hundred pictures take hours";
        watch(Progress::Says(slow.to_owned()));
    }
    let seconds = workplace.run(&program, &listed, options, watch)?;
    let (log, name) = (workplace.log(), program.name());
    let models = models(&workplace.sparse())?;
    let pieces: Vec<usize> = models.iter().map(|(_, model)| model.views.len()).collect();
    let no_model = || StructureError::NoModel { program: name, log: log.clone() };
    let (model, read) = models.into_iter().next().ok_or_else(no_model)?;
    let masks = options.masks.as_deref();
    let posed = pictures_of_model(read, (&model, &listed.folder), masks)?;
    if posed.inputs.len() < 2 {
        return Err(StructureError::TooFew { program: name, found: posed.inputs.len(), log });
    }
    let found: HashSet<_> = posed.inputs.iter().map(|input| input.name.as_str()).collect();
    let (found, missing): (Vec<_>, Vec<_>) =
        listed.names.iter().partition(|name| found.contains(name.as_str()));
    let missing: Vec<String> = missing.into_iter().cloned().collect();
    let left_out = missing::reason(&listed.folder, (&found, &missing), &pieces, options.matching);
    let pictures = listed.names.len();
    let stated = options.camera_params.as_ref();
    let freed = stated.map(|_| workplace.freed(&program, &model)).transpose()?;
    let freed = freed.map(|folder| ColmapModel::open(&folder)).transpose()?;
    let (mut posed, scale) = unit::scaled(posed);
    let reprojection_error = judge::reprojection_error(&posed);
    let mut doubtful = judge::doubtful(&posed, options.size, reprojection_error);
    doubtful.extend(left_out);
    doubtful.extend(freed.and_then(|freed| judge::stated_lens(&posed, &freed)));
    let navigation = options.navigation.as_ref();
    let alignment = navigation.map(|navigation| navigation.align(&mut posed)).transpose()?;
    doubtful.extend(alignment.as_ref().and_then(judge::elsewhere));
    round::round(&mut posed);
    Ok(Structure {
        posed,
        alignment,
        pictures,
        missing,
        reprojection_error,
        doubtful,
        seconds,
        model,
        scale,
    })
}

/// The models and their folders; the one with most pictures first.
fn models(sparse: &Path) -> Result<Vec<(PathBuf, ColmapModel)>, StructureError> {
    let mut models = Vec::new();
    for entry in std::fs::read_dir(sparse).map_err(StructureError::file(sparse))? {
        let folder = entry.map_err(StructureError::file(sparse))?.path();
        if ColmapModel::is_in(&folder) {
            let model = ColmapModel::open(&folder)?;
            models.push((folder, model));
        }
    }
    models.sort_by(|(a, one), (b, other)| {
        other.views.len().cmp(&one.views.len()).then_with(|| a.cmp(b))
    });
    Ok(models)
}
