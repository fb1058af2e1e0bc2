//! Twin of stage `splat_flow`: each splat in a pixel moves with the flow of the pixel's own ray at
//! the splat's depth. It follows the definition: a whole Jacobian goes through the blending.

use glam::DVec2;

use super::Viewpoint;
use super::pose_jacobian::Motion;
use super::project::Projected;
use super::splat::{Hit, blend_rows};
use super::splat_exact::MovingPixel;

/// The optical flow at a pixel centre for depth `z` (Longuet-Higgins and Prazdny 1980), with
/// `dp = ρ + θ × p`: `du = fx (ρx − x ρz)/z + fx (−xy θx + (1 + x²) θy − y θz)`, `dv` likewise.
pub fn flow(view: &Viewpoint, centre: DVec2, z: f64) -> Motion {
    let c = view.camera;
    let (fx, fy) = (f64::from(c.fx), f64::from(c.fy));
    let x = (centre.x - f64::from(c.cx)) / fx;
    let y = (centre.y - f64::from(c.cy)) / fy;
    Motion {
        mean: [
            [1.0 / z, 0.0, -x / z, -x * y, 1.0 + x * x, -y].map(|d| fx * d),
            [0.0, 1.0 / z, -y / z, -(1.0 + y * y), x * y, x].map(|d| fy * d),
        ],
        ..Motion::default()
    }
}

/// Every pixel with its derivatives, from `seen` in depth order.
pub fn blend(view: &Viewpoint, seen: &[Projected]) -> Vec<MovingPixel> {
    blend_rows(seen, view.camera, &MovingPixel::default(), |pixel, i, centre| {
        if let Some(hit) = Hit::at(&seen[i], view.options, centre) {
            pixel.blend(&seen[i], &hit, &flow(view, centre, seen[i].camera.z));
        }
    })
}
