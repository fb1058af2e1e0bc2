//! What is wanted of the search for poses, and what is known before.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::{Finder, StructureError};
use crate::navigation::{Alignment, NavigationError, StatedCourse, align};
use crate::posed::PosedPictures;
use crate::video::frame_times;

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
    /// Names of pictures on which poses are found; those of the others follow from them. Empty: all.
    pub first: Vec<String>,
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

    pub(super) fn align(&self, posed: &mut PosedPictures) -> Result<Alignment, NavigationError> {
        let stated = |name: &str| self.course.of(name, self.times.get(name).copied());
        let stated: Vec<_> = posed.inputs.iter().map(|input| stated(&input.name)).collect();
        align(posed, &stated, self.tilt, &self.path)
    }
}
