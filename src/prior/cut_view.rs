//! Views of which the near plane leaves nothing.

use glam::DVec3;

use super::Prior;
use crate::geometry::{Camera, Pose};

impl Prior {
    /// Whether a view from a pose in the world looks at splats, by their means, and all are nearer than the near plane:
    /// it shows nothing then.
    pub fn is_cut_by_near_plane(&self, camera: &Camera, pose: &Pose) -> bool {
        let pose = pose.relative_to(self.origin());
        let (near, rotation) = (f64::from(self.options().near), pose.matrix());
        let (wide, high) = (f64::from(camera.width), f64::from(camera.height));
        let depth = |position: &[f32; 3]| {
            let p = rotation * DVec3::from(position.map(f64::from)) + pose.translation;
            let x = f64::from(camera.fx) * p.x / p.z + f64::from(camera.cx);
            let y = f64::from(camera.fy) * p.y / p.z + f64::from(camera.cy);
            let is_seen = p.z > 0.0 && (0.0..wide).contains(&x) && (0.0..high).contains(&y);
            is_seen.then_some(p.z)
        };
        let farthest = self.splats().positions.iter().filter_map(depth).reduce(f64::max);
        farthest.is_some_and(|depth| depth <= near)
    }
}
