//! Pictures without poses: COLMAP or pycolmap finds these first.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use nvsprior_inputs::navigation;
use nvsprior_inputs::posed::PosedPictures;
use nvsprior_inputs::structure::{
    DEPTH, Finder, Lenses, Matching, Navigation, Structure, StructureOptions, find_poses,
};

use nvsprior_inputs::values;

use super::report::Poses;
use super::saved::beside;
use super::shown::Shown;

/// Which pictures to find poses of, and how.
#[derive(clap::Args)]
#[command(next_help_heading = "Pictures without poses (by COLMAP or pycolmap)")]
pub struct StructureArgs {
    /// Pictures without poses: a folder of them, or video files, of which frames are chosen into the folder
    /// OUT.frames. Their poses are found in the folder OUT.colmap. Both folders are kept: what is finished there is
    /// not done again
    #[arg(value_name = "PICTURES", id = "unposed")]
    unposed: Vec<PathBuf>,
    /// What finds the poses: `colmap` (on the PATH), `pycolmap` (a Python package; it is installed into a folder of its
    /// own if it is not there), a program (another COLMAP, or a Python with pycolmap), or `auto`: COLMAP 4, else
    /// pycolmap, else an older COLMAP [default: auto]
    #[arg(long, value_name = "WHICH", conflicts_with = "cameras", value_parser = finder)]
    poses: Option<Finder>,
    /// COLMAP's camera model [default: RADIAL], and, behind a colon, its parameters with commas between, in COLMAP's
    /// order (OPENCV:fx,fy,cx,cy,k1,k2,p1,p2), if the camera was calibrated; they are kept as they are
    #[arg(long, alias = "camera-model", value_name = "MODEL[:NUMBERS]", conflicts_with = "cameras",
        value_parser = camera)]
    camera: Option<CameraArg>,
    /// Which pictures share intrinsics [default: one, that is, all]
    #[arg(long, value_name = "WHICH", conflicts_with = "cameras", value_parser = values::named(&LENSES))]
    lenses: Option<Lenses>,
    /// Which pairs of pictures are compared: all, those near each other by name (the order of time), or `auto`: these,
    /// and those that show the same place [default: auto]
    #[arg(long, value_name = "WHICH", conflicts_with = "cameras", value_parser = values::named(&MATCHING))]
    matching: Option<Matching>,
    /// What the vehicle states of its course, a CSV with the columns `file` or `time` (of the video, seconds), and some
    /// of `north`, `east`, `depth` (metres), `heading`, `pitch`, `roll` (degrees): the prior's unit becomes a metre,
    /// and its axes north, east, down. TILT: how far the camera looks up if the vehicle is level, degrees; below zero:
    /// down; 0 if it is left out
    #[arg(long, value_name = "FILE[,TILT]", conflicts_with = "cameras", value_parser = stated)]
    navigation: Option<(PathBuf, f64)>,
}

fn finder(text: &str) -> Result<Finder, String> {
    match text {
        "" => Err("auto, colmap, pycolmap, or a program's file".into()),
        "auto" => Ok(Finder::Auto),
        "colmap" => Ok(Finder::Colmap),
        "pycolmap" => Ok(Finder::Pycolmap),
        file => Ok(Finder::File(file.into())),
    }
}

/// A file of navigation, and the tilt of the camera.
fn stated(text: &str) -> Result<(PathBuf, f64), String> {
    let (file, tilt) = text.rsplit_once(',').unwrap_or((text, "0"));
    Ok((file.into(), values::tilt(tilt).map_err(|error| format!("the tilt: {error}"))?))
}

/// Camera models of which pictures can be undistorted.
const MODELS: [&str; 6] =
    ["SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE"];

/// A camera model, and its parameters if they are known.
#[derive(Clone)]
struct CameraArg {
    model: String,
    params: Option<String>,
}

fn camera(text: &str) -> Result<CameraArg, String> {
    let (model, params) = text.split_once(':').map_or((text, None), |(m, p)| (m, Some(p)));
    if !MODELS.contains(&model) {
        return Err(format!("there are {}", MODELS.join(", ")));
    }
    Ok(CameraArg { model: model.into(), params: params.map(camera_params).transpose()? })
}

/// Finite numbers with commas between, as COLMAP wants them. It checks that they are as many as the model has.
fn camera_params(text: &str) -> Result<String, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|v| v.trim().parse()).collect();
    let numbers = numbers.map_err(|e| format!("{e}"))?;
    match numbers.iter().all(|v| v.is_finite()) {
        true => Ok(numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(",")),
        false => Err("all numbers must be finite".into()),
    }
}

const LENSES: [(&str, Lenses); 3] =
    [("one", Lenses::One), ("folder", Lenses::Folder), ("picture", Lenses::Picture)];
const MATCHING: [(&str, Matching); 3] = [
    ("auto", Matching::Auto),
    ("exhaustive", Matching::Exhaustive),
    ("sequential", Matching::Sequential),
];

impl StructureArgs {
    /// The pictures or videos that were given.
    pub fn unposed(&self) -> &[PathBuf] {
        &self.unposed
    }

    pub fn lenses(&self) -> Lenses {
        self.lenses.unwrap_or(Lenses::One)
    }

    /// Finds the poses of pictures, if there are any without.
    pub fn find(
        &self,
        pictures: Option<&Unposed>,
        how: &Search,
        navigation: Option<Navigation>,
    ) -> anyhow::Result<Option<(PosedPictures, Poses)>> {
        let Some(pictures) = pictures else { return Ok(None) };
        let mut options = self.options(pictures, how);
        options.navigation =
            navigation.map(|stated| stated.with_times(&pictures.folder)).transpose()?;
        let mut shown = Shown::default();
        let found =
            find_poses(&pictures.folder, &beside(how.out, ".colmap"), &options, &mut |progress| {
                shown.show(progress)
            })?;
        describe(&found);
        let poses = Poses::of(&found);
        Ok(Some((found.posed, poses)))
    }

    fn options(&self, pictures: &Unposed, how: &Search) -> StructureOptions {
        let camera = self.camera.clone();
        let CameraArg { model, params } =
            camera.unwrap_or_else(|| CameraArg { model: "RADIAL".into(), params: None });
        StructureOptions {
            finder: self.poses.clone().unwrap_or(Finder::Auto),
            camera_model: model,
            camera_params: params,
            lenses: self.lenses(),
            matching: self.matching.unwrap_or(Matching::Auto),
            sequence: pictures.sequence,
            first: pictures.first.clone(),
            size: how.matched(),
            masks: how.masks.map(Path::to_path_buf),
            navigation: None,
            seed: how.seed,
        }
    }

    /// Reads what the vehicle states, before hours of work.
    pub fn navigation(&self) -> anyhow::Result<Option<Navigation>> {
        let Some((path, tilt)) = &self.navigation else { return Ok(None) };
        let (path, course, tilt) = (path.clone(), navigation::read(path)?, tilt.to_radians());
        Ok(Some(Navigation { path, course, times: HashMap::new(), tilt }))
    }
}

/// Longest side of the pictures that are matched, pixels; that of those that are trained on, if it is larger.
const MATCHED: u32 = 1280;

/// What else the search for poses depends on.
pub struct Search<'a> {
    /// The prior: the work folder lies beside it.
    pub out: &'a Path,
    pub masks: Option<&'a Path>,
    /// Width of the pictures that are trained on; `None`: as they are.
    pub width: Option<u32>,
    pub seed: u64,
}

impl Search<'_> {
    /// Longest side to which pictures are reduced for matching, pixels.
    pub fn matched(&self) -> u32 {
        self.width.unwrap_or(u32::MAX).max(MATCHED)
    }
}

/// Pictures without poses.
pub struct Unposed {
    pub folder: PathBuf,
    /// They are frames of a video, in the order of time.
    pub sequence: bool,
    /// Names of those on which poses are found first; empty: all.
    pub first: Vec<String>,
}

/// In what unit and axes the poses are.
fn unit(found: &Structure) -> String {
    let Structure { model, scale, alignment, .. } = found;
    let aligned = alignment.as_ref();
    let unit = match aligned.and_then(|aligned| aligned.metres) {
        Some(metres) => format!("in metres, {:.4} for one of {}", metres * scale, model.display()),
        None => format!(
            "{} multiplied by {scale:.4}, so that the median depth of the scene is {DEPTH}",
            model.display()
        ),
    };
    let Some(aligned) = aligned else { return unit };
    let up = if aligned.upright { ", z is down" } else { "" };
    let off =
        aligned.off.map_or(String::new(), |off| format!(", {off:.2} m off the stated places"));
    let origin = aligned.origin;
    let origin = match aligned.metres {
        Some(_) => format!(", from {} m north, {} m east, {} m deep", origin.x, origin.y, origin.z),
        None => String::new(),
    };
    format!("{unit}{origin}{up}{off} (stated of {} pictures)", aligned.pictures)
}

/// Names of pictures that a warning lists.
const LISTED: usize = 10;
fn describe(found: &Structure) {
    let Structure { posed, pictures, missing, .. } = found;
    let registered = posed.inputs.len();
    let error = found.reprojection_error.map(|error| format!(", error {error:.2} pixels"));
    let error = error.unwrap_or_default();
    tell!("poses of {registered} of {pictures} pictures{error}; {}", unit(found));
    for reason in &found.doubtful {
        tell!("warning: {reason}");
    }
    if missing.is_empty() {
        return;
    }
    let listed = missing.iter().take(LISTED).cloned().collect::<Vec<_>>().join(", ");
    let others = missing.len().saturating_sub(LISTED);
    let others = if others > 0 { format!(" and {others} more") } else { String::new() };
    tell!("no pose was found of {listed}{others}; they are left out");
}
