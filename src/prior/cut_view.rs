//! Views of which the near plane leaves nothing.

use glam::DVec3;

use super::Prior;
use crate::geometry::{Camera, Pose};

impl Prior {
    /// Whether a view looks at splats, by their means, and all are nearer than the near plane: it shows nothing then.
    pub fn is_cut_by_near_plane(&self, camera: &Camera, pose: &Pose) -> bool {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prior::{RenderOptions, Splats};

    #[test]
    fn a_view_of_which_nothing_is_left_is_told() {
        let wall = |z: f32| {
            let positions = (0..9).map(|i| [(i % 3) as f32 * 0.01, (i / 3) as f32 * 0.01, z]);
            let mut splats = Splats { positions: positions.collect(), ..Splats::default() };
            splats.log_scales = vec![[-5.0; 3]; 9];
            splats.rotations = vec![[1.0, 0.0, 0.0, 0.0]; 9];
            splats.opacity_logits = vec![2.0; 9];
            splats.sh = vec![0.0; 27];
            Prior::from_splats(splats, RenderOptions::INRIA).unwrap()
        };
        let camera = Camera { width: 32, height: 18, fx: 30.0, fy: 30.0, cx: 16.0, cy: 9.0 };
        let near = f64::from(RenderOptions::INRIA.near);
        let is_cut = |z: f64| wall(z as f32).is_cut_by_near_plane(&camera, &Pose::IDENTITY);
        assert!(is_cut(near / 2.0));
        assert!(!is_cut(near * 2.0));
        assert!(!is_cut(-1.0), "nothing is looked at");
    }
}
