//! What a vehicle states of its course: places, depths and attitudes, in a CSV file. Poses that structure from motion
//! finds have no unit and no vertical; these give both.

mod align;
mod read;

use std::path::PathBuf;

use glam::{DMat3, DVec3};

pub use align::{Alignment, align};
pub use read::{Key, StatedCourse, read};

/// What is stated of a picture. Any part may be missing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stated {
    /// Metres north and east of any fixed place.
    pub place: Option<[f64; 2]>,
    /// Metres below the surface.
    pub depth: Option<f64>,
    /// Radians: how far the camera looks up, and how far it is turned clockwise about the axis along which it looks.
    pub pitch_roll: Option<[f64; 2]>,
    /// Radians clockwise from north: where the camera looks.
    pub heading: Option<f64>,
}

impl Stated {
    /// North, east, down; if all of it is stated.
    pub fn position(&self) -> Option<DVec3> {
        let ([north, east], depth) = (self.place?, self.depth?);
        Some(DVec3::new(north, east, depth))
    }

    /// The directions north, east and down as the camera sees them, columns; `tilt`: how far the camera looks up if the
    /// vehicle is level, radians. Without a heading north is where the camera looks.
    pub fn seen(&self, tilt: f64) -> Option<DMat3> {
        let [pitch, roll] = self.pitch_roll?;
        let turn = DMat3::from_rotation_z(self.heading.unwrap_or(0.0))
            * DMat3::from_rotation_y(pitch)
            * DMat3::from_rotation_x(roll)
            * DMat3::from_rotation_y(tilt);
        // The camera's right, down and forward in the vehicle's forward, right, down.
        let camera = DMat3::from_cols(DVec3::Y, DVec3::Z, DVec3::X);
        Some((turn * camera).transpose())
    }
}

/// Why a stated course cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum NavigationError {
    #[error("{}: {error}", path.display())]
    Csv { path: PathBuf, error: csv::Error },
    #[error(
        "{}: its columns must be `file` or `time`, and some of `north`, `east`, `depth` (metres), `heading`, `pitch`, \
         `roll` (degrees); {what}",
        path.display()
    )]
    Columns { path: PathBuf, what: String },
    #[error("{}: row {row}: {what}", path.display())]
    Row { path: PathBuf, row: usize, what: String },
    #[error(
        "{}: it tells times, but the pictures have none: they are not of one video; name them in a column `file`",
        path.display()
    )]
    NoTimes { path: PathBuf },
    #[error(
        "{}: it states something of {count} of the pictures whose poses were found; at least three are needed",
        path.display()
    )]
    Few { path: PathBuf, count: usize },
    #[error(
        "{}: neither places that lie apart, nor depths and attitudes that differ: nothing says how large the scene is, \
         or which way is up",
        path.display()
    )]
    Nothing { path: PathBuf },
}
