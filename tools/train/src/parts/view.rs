//! What a camera has in view, whatever stands in between.

use glam::DVec3;
use nvsprior::{Camera, Pose};

/// A camera at its pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    pub camera: Camera,
    pub pose: Pose,
}

/// Where a place shows.
pub struct Shown {
    /// Shares of the picture's width and height.
    pub at: [f64; 2],
    pub depth: f64,
}

impl View {
    /// Where a place shows, if it is in view. `near`: least depth.
    pub fn of(&self, place: DVec3, near: f64) -> Option<Shown> {
        let seen = self.pose.rotation * place + self.pose.translation;
        if !(seen.z > near) {
            return None;
        }
        let Camera { width, height, fx, fy, cx, cy } = self.camera;
        let share = |v: f64, focal: f32, centre: f32, side: u32| {
            (f64::from(focal) * v / seen.z + f64::from(centre)) / f64::from(side)
        };
        let at = [share(seen.x, fx, cx, width), share(seen.y, fy, cy, height)];
        let inside = at.iter().all(|share| (0.0..1.0).contains(share));
        inside.then_some(Shown { at, depth: seen.z })
    }
}
