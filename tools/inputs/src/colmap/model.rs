//! What a model's files hold: cameras, of COLMAP's camera models, pictures and points.

use glam::DVec3;
use nvsprior::geometry::{Distortion, Intrinsics, Lens};

use super::error::{ColmapFault, FilePosition, Wrong};
use crate::points::Point;

/// A camera model that is read.
pub struct Model {
    pub name: &'static str,
    pub parameters: usize,
    /// The parts of a lens, from that many parameters.
    parts: fn(&[f64]) -> Option<Parts>,
}

/// fx, fy, cx, cy and the distortion.
type Parts = ([f64; 4], Distortion);

/// Those that are read, by COLMAP's number for them.
static MODELS: [Model; 7] = [
    Model { name: "SIMPLE_PINHOLE", parameters: 3, parts: |p| simple(p, [0.0; 2]) },
    Model {
        name: "PINHOLE",
        parameters: 4,
        parts: |p| Some((p.first_chunk().copied()?, Distortion::None)),
    },
    Model { name: "SIMPLE_RADIAL", parameters: 4, parts: |p| simple(p, [*p.get(3)?, 0.0]) },
    Model { name: "RADIAL", parameters: 5, parts: |p| simple(p, [*p.get(3)?, *p.get(4)?]) },
    Model {
        name: "OPENCV",
        parameters: 8,
        parts: |p| Some((p.first_chunk().copied()?, Distortion::brown(p.get(4..)?).ok()?)),
    },
    Model {
        name: "OPENCV_FISHEYE",
        parameters: 8,
        parts: |p| {
            let distortion = Distortion::Fisheye(p.last_chunk().copied()?);
            Some((p.first_chunk().copied()?, distortion))
        },
    },
    Model {
        name: "FULL_OPENCV",
        parameters: 12,
        parts: |p| Some((p.first_chunk().copied()?, Distortion::brown(p.get(4..)?).ok()?)),
    },
];

/// COLMAP's names of the models that follow, to refuse them by name.
const OTHERS: [&str; 7] = [
    "FOV",
    "SIMPLE_RADIAL_FISHEYE",
    "RADIAL_FISHEYE",
    "THIN_PRISM_FISHEYE",
    "RAD_TAN_THIN_PRISM_FISHEYE",
    "SIMPLE_DIVISION",
    "DIVISION",
];

/// Parameters that begin with f, cx, cy, and two radial coefficients.
fn simple(p: &[f64], [k1, k2]: [f64; 2]) -> Option<Parts> {
    let [f, cx, cy] = *p.first_chunk()?;
    Some(([f, f, cx, cy], Distortion::brown(&[k1, k2, 0.0, 0.0]).ok()?))
}

impl Model {
    pub fn numbered(number: u32) -> Result<&'static Model, ColmapFault> {
        let index = number as usize;
        MODELS.get(index).ok_or_else(|| {
            let other = OTHERS.get(index.saturating_sub(MODELS.len()));
            let model = other.map_or_else(|| format!("number {number}"), |name| (*name).to_owned());
            ColmapFault::Model { model }
        })
    }

    pub fn named(name: &str) -> Result<&'static Model, ColmapFault> {
        let model = || ColmapFault::Model { model: name.to_owned() };
        MODELS.iter().find(|model| model.name == name).ok_or_else(model)
    }

    /// The lens of a camera of this model.
    pub fn lens(&self, camera: &CameraRecord) -> Result<Lens, ColmapFault> {
        let (due, found) = (self.parameters, camera.parameters.len());
        let parts = (found == due).then(|| (self.parts)(&camera.parameters)).flatten();
        let wrong = ColmapFault::Parameters { model: self.name, due, found };
        let ([fx, fy, cx, cy], distortion) = parts.ok_or(wrong)?;
        // What does not fit is too large, too.
        let [width, height] =
            [camera.width, camera.height].map(|side| u32::try_from(side).unwrap_or(u32::MAX));
        let intrinsics = Intrinsics { width, height, fx, fy, cx, cy };
        Ok(Lens::new(intrinsics, distortion)?)
    }
}

/// A camera as a file has it.
pub struct CameraRecord {
    pub at: FilePosition,
    pub id: u32,
    pub model: &'static Model,
    pub width: u64,
    pub height: u64,
    pub parameters: Vec<f64>,
}

/// A picture as a file has it.
pub struct ImageRecord {
    pub at: FilePosition,
    /// w, x, y, z.
    pub quaternion: [f64; 4],
    pub translation: [f64; 3],
    pub camera: u32,
    pub name: String,
}

/// A point; COLMAP writes −1 for an error that it did not compute.
pub fn point(
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
