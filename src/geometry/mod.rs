//! Where a camera stands and how it projects.

mod camera;
mod lens;
mod pose;

pub use camera::{Camera, CameraError};
pub use lens::{Distortion, Footprint, Intrinsics, Lens, LensError};
pub use pose::{Pose, Twist, rotation_of};
