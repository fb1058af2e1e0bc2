//! Poses of pictures that have none, by structure from motion: the steps of COLMAP are run in a folder that is kept.
//!
//! COLMAP 4, or pycolmap by the same command line, solves for all poses at once. COLMAP 3.8 (Debian's) and later ones
//! are run as well. All run on the CPU. Options that were renamed are told by each step's help.

mod error;
mod finding;
mod judge;
mod missing;
mod models;
mod options;
mod pairs;
mod pictures;
mod program;
mod record;
mod round;
mod steps;
mod unit;

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use crate::colmap::ColmapModel;
use crate::navigation::Alignment;
use crate::posed::{PosedPictures, pictures_of_model};
use crate::progress::{Progress, Watch};
pub use error::{Ended, StructureError};
pub use finding::Finder;
pub use judge::Doubtful;
use models::models;
pub use options::{Lenses, Matching, Navigation, StructureOptions};
use pictures::Listed;
use steps::Workplace;
pub use unit::DEPTH;

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

/// The files of a folder's pictures and of those below it. Their sizes must be as their lenses want them.
pub fn pictures(folder: &Path, lenses: Lenses) -> Result<Vec<PathBuf>, StructureError> {
    let Listed { folder, names, .. } = Listed::of(folder, lenses)?;
    Ok(names.iter().map(|name| folder.join(name)).collect())
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
    let pieces = workplace.pieces()?;
    let pieces: Vec<usize> = pieces.iter().map(|(_, model)| model.views.len()).collect();
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
