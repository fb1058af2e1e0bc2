//! COLMAP's sparse models, as COLMAP 3.8 writes them: `cameras`, `images` and `points3D`, all as
//! `.bin` or all as `.txt`; as `.bin` if both are there. Source of the layout: COLMAP's documentation,
//! "Output Format", and its `Reconstruction::Read…` functions.
//!
//! Poses are world-to-camera with OpenCV's axes, and pixel centres lie at +0.5, as in this project.
//! Later COLMAPs add `rigs` and `frames`, which are not needed: `images` keeps its poses.

mod binary;
mod error;
mod model;
mod text;

use std::collections::{HashMap, HashSet};
use std::path::Path;

use nvsprior::Pose;

use crate::points::Point;
use error::Wrong;
pub use error::{ColmapError, ColmapFault, FilePosition};
use model::{CameraRecord, ImageRecord};
use nvsprior::geometry::Lens;

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

/// How far a quaternion's length may be off 1; COLMAP writes it to 1e-15.
const UNIT_TOLERANCE: f64 = 1e-3;

/// What reads cameras, pictures and points.
type Parsers = (Parser<CameraRecord>, Parser<ImageRecord>, Parser<Point>);
type Parser<T> = fn(&[u8]) -> Result<Vec<T>, Wrong>;

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
        let (in_cameras, in_images, in_points): Parsers = match binary {
            true => (binary::cameras, binary::images, binary::points),
            false => (text::cameras, text::images, text::points),
        };
        let cameras = read(&cameras, |bytes| lenses(&in_cameras(bytes)?))?;
        let views = read(&images, |bytes| views(in_images(bytes)?, &cameras))?;
        let points = read(&points, in_points)?;
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

fn views(
    mut images: Vec<ImageRecord>,
    lenses: &HashMap<u32, Lens>,
) -> Result<Vec<ColmapView>, Wrong> {
    let mut names = HashSet::with_capacity(images.len());
    for image in &mut images {
        // As Windows writes folders.
        image.name = image.name.replace('\\', "/");
    }
    for image in &images {
        if !names.insert(image.name.as_str()) {
            let what = image.name.clone();
            return Err(Wrong::new(image.at, ColmapFault::Twice { what }));
        }
    }
    let views = images.into_iter().map(|image| view(image, lenses));
    let mut views = views.collect::<Result<Vec<_>, _>>()?;
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

/// A pose of a unit quaternion (w, x, y, z); `None` if that is none, or anything is not finite.
pub(crate) fn unit_pose(quaternion: [f64; 4], translation: [f64; 3]) -> Option<Pose> {
    let length = quaternion.iter().map(|v| v * v).sum::<f64>().sqrt();
    let unit = (length - 1.0).abs() <= UNIT_TOLERANCE;
    if unit { Pose::from_wxyz(quaternion, translation) } else { None }
}

#[cfg(test)]
mod tests;
