//! Where a camera stands and how it projects.

mod camera;
mod pose;

pub use camera::{Camera, CameraError};
pub use pose::{Pose, Step};
