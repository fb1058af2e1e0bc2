//! COLMAP's sparse models, as COLMAP 3.8 writes them: `cameras`, `images` and `points3D`, all as
//! `.bin` or all as `.txt`; as `.bin` if both are there. Source of the layout: COLMAP's documentation,
//! "Output Format", and its `Reconstruction::Read…` functions.
//!
//! Poses are world-to-camera with OpenCV's axes, and pixel centres lie at +0.5, as in this project.
//! Later COLMAPs add `rigs` and `frames`, which are not needed: `images` keeps its poses.

mod binary;
mod model;
mod text;

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

use glam::DVec3;
use nvsprior::Pose;

use crate::points::Point;
use model::Model;
use nvsprior::geometry::{Lens, LensError};

#[derive(Clone, Debug, PartialEq)]
pub struct ColmapModel {
    /// Its pictures, by name.
    pub views: Vec<ColmapView>,
    /// Its points: all with a colour and a track; with an error if COLMAP computed it.
    pub points: Vec<Point>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct ColmapView {
    /// Its file, from the folder of pictures.
    pub name: String,
    /// World to camera.
    pub pose: Pose,
    /// What it was taken with.
    pub lens: Lens,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FilePosition {
    /// A byte, counted from 0.
    Byte(usize),
    /// A line, counted from 1.
    Line(usize),
}

impl std::fmt::Display for FilePosition {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            FilePosition::Byte(byte) => write!(f, "byte {byte}"),
            FilePosition::Line(line) => write!(f, "line {line}"),
        }
    }
}

/// Why a sparse model cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ColmapError {
    #[error("{}: {error}", path.display())]
    Read { path: PathBuf, error: std::io::Error },
    #[error("{}: neither cameras.bin nor cameras.txt in it; give the folder of a COLMAP model, such \
        as sparse/0", folder.display())]
    Missing { folder: PathBuf },
    #[error("{}: {at}: {fault}", path.display())]
    Content { path: PathBuf, at: FilePosition, fault: ColmapFault },
}

/// What is wrong at a place of a model's file.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ColmapFault {
    #[error("the file ends before {what}; is it cut off?")]
    Cut { what: &'static str },
    #[error("{count} more bytes follow than the file says")]
    Rest { count: usize },
    #[error("{what} is missing")]
    Missing { what: &'static str },
    #[error("\"{found}\" as {what}")]
    Word { what: &'static str, found: String },
    #[error("{count} numbers of observations; three are due for each")]
    Observations { count: usize },
    #[error("the text is not UTF-8")]
    Text,
    #[error("the picture has no name")]
    Name,
    #[error("{what} stands there twice")]
    Twice { what: String },
    #[error(
        "camera model {model} is not read, but SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, \
        OPENCV and OPENCV_FISHEYE are; run `colmap image_undistorter`, and use the model and \
        pictures that it writes"
    )]
    Model { model: String },
    #[error("{found} camera parameters; {model} has {due}")]
    Parameters { model: &'static str, due: usize, found: usize },
    #[error(transparent)]
    Lens(#[from] LensError),
    #[error("{name}: camera {camera} is not among the cameras")]
    Camera { name: String, camera: u32 },
    #[error("{name}: its quaternion must be of length 1, and its translation finite")]
    Pose { name: String },
    #[error("a point whose position or error is not finite")]
    Point,
}

struct Wrong {
    at: FilePosition,
    fault: ColmapFault,
}

impl Wrong {
    fn new(at: FilePosition, fault: impl Into<ColmapFault>) -> Wrong {
        Wrong { at, fault: fault.into() }
    }

    fn of(self, path: &Path) -> ColmapError {
        ColmapError::Content { path: path.to_path_buf(), at: self.at, fault: self.fault }
    }
}

/// A camera as a file has it.
struct CameraRecord {
    at: FilePosition,
    id: u32,
    model: &'static Model,
    width: u64,
    height: u64,
    parameters: Vec<f64>,
}

/// A picture as a file has it.
struct ImageRecord {
    at: FilePosition,
    /// w, x, y, z.
    quaternion: [f64; 4],
    translation: [f64; 3],
    camera: u32,
    name: String,
}

/// How far a quaternion's length may be off 1; COLMAP writes it to 1e-15.
const UNIT_TOLERANCE: f64 = 1e-3;

impl ColmapModel {
    /// Whether a folder holds a model.
    pub fn is_in(folder: &Path) -> bool {
        ["cameras.bin", "cameras.txt"].iter().any(|name| folder.join(name).is_file())
    }

    pub fn open(folder: &Path) -> Result<ColmapModel, ColmapError> {
        if !ColmapModel::is_in(folder) {
            return Err(ColmapError::Missing { folder: folder.to_path_buf() });
        }
        let binary = folder.join("cameras.bin").is_file();
        let [cameras, images, points] = ["cameras", "images", "points3D"]
            .map(|name| folder.join(name).with_extension(if binary { "bin" } else { "txt" }));
        let cameras = if binary {
            read(&cameras, |bytes| lenses(&binary::cameras(bytes)?))
        } else {
            read(&cameras, |bytes| lenses(&text::cameras(bytes)?))
        }?;
        let views = if binary {
            read(&images, |bytes| views(binary::images(bytes)?, &cameras))
        } else {
            read(&images, |bytes| views(text::images(bytes)?, &cameras))
        }?;
        let points = read(&points, if binary { binary::points } else { text::points })?;
        Ok(ColmapModel { views, points })
    }
}

fn read<T>(path: &Path, parse: impl Fn(&[u8]) -> Result<T, Wrong>) -> Result<T, ColmapError> {
    let failed = |error| ColmapError::Read { path: path.to_path_buf(), error };
    let bytes = std::fs::read(path).map_err(failed)?;
    parse(&bytes).map_err(|wrong| wrong.of(path))
}

/// The lenses by the numbers of their cameras.
fn lenses(cameras: &[CameraRecord]) -> Result<HashMap<u32, Lens>, Wrong> {
    let mut lenses = HashMap::with_capacity(cameras.len());
    for camera in cameras {
        let lens = camera.model.lens(camera).map_err(|e| Wrong::new(camera.at, e))?;
        if lenses.insert(camera.id, lens).is_some() {
            let what = format!("camera {}", camera.id);
            return Err(Wrong::new(camera.at, ColmapFault::Twice { what }));
        }
    }
    Ok(lenses)
}

fn views(images: Vec<ImageRecord>, lenses: &HashMap<u32, Lens>) -> Result<Vec<ColmapView>, Wrong> {
    let mut names = HashSet::with_capacity(images.len());
    for image in &images {
        if !names.insert(image.name.as_str()) {
            let what = image.name.clone();
            return Err(Wrong::new(image.at, ColmapFault::Twice { what }));
        }
    }
    let views: Result<Vec<ColmapView>, Wrong> =
        images.into_iter().map(|image| view(image, lenses)).collect();
    let mut views = views?;
    views.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(views)
}

fn view(image: ImageRecord, lenses: &HashMap<u32, Lens>) -> Result<ColmapView, Wrong> {
    let ImageRecord { at, quaternion, translation, camera, name } = image;
    let Some(pose) = unit_pose(quaternion, translation) else {
        return Err(Wrong::new(at, ColmapFault::Pose { name }));
    };
    match lenses.get(&camera) {
        Some(lens) => Ok(ColmapView { name, pose, lens: *lens }),
        None => Err(Wrong::new(at, ColmapFault::Camera { name, camera })),
    }
}

/// A point; COLMAP writes −1 for an error that it did not compute.
fn point(
    at: FilePosition,
    position: DVec3,
    rgb: [u8; 3],
    error: f64,
    track: usize,
) -> Result<Point, Wrong> {
    if !(position.is_finite() && error.is_finite()) {
        return Err(Wrong::new(at, ColmapFault::Point));
    }
    let rgb = Some(rgb.map(|value| f32::from(value) / 255.0));
    let track = Some(u32::try_from(track).unwrap_or(u32::MAX));
    Ok(Point { position, rgb, error: (error >= 0.0).then_some(error), track })
}

/// A pose of a unit quaternion (w, x, y, z); `None` if that is none, or anything is not finite.
pub(crate) fn unit_pose(quaternion: [f64; 4], translation: [f64; 3]) -> Option<Pose> {
    let length = quaternion.iter().map(|v| v * v).sum::<f64>().sqrt();
    let unit = (length - 1.0).abs() <= UNIT_TOLERANCE;
    if unit { Pose::from_wxyz(quaternion, translation) } else { None }
}

#[cfg(test)]
mod tests;
