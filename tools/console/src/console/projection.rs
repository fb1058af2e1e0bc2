//! Points of the scene in pictures.

use glam::DVec3;
use nvsprior::{Camera, Pose};

/// Pixels.
pub type Pixel = [f32; 2];

/// Where a point is seen; `None`: it lies behind the camera, or too close to it.
pub fn project(camera: &Camera, pose: &Pose, point: DVec3, near: f64) -> Option<Pixel> {
    let seen = pose.rotation * point + pose.translation;
    if !(seen.z > near) {
        return None;
    }
    let x = f64::from(camera.fx) * seen.x / seen.z + f64::from(camera.cx);
    let y = f64::from(camera.fy) * seen.y / seen.z + f64::from(camera.cy);
    // Tenths of a pixel are enough to draw.
    Some([x, y].map(|value| (value * 10.0).round() as f32 / 10.0))
}

/// A line through points. If some are out of sight, the line has several parts.
pub fn lines(
    camera: &Camera,
    pose: &Pose,
    points: impl IntoIterator<Item = DVec3>,
    near: f64,
) -> Vec<Vec<Pixel>> {
    let mut lines = vec![Vec::new()];
    for point in points {
        match (project(camera, pose, point, near), lines.last_mut()) {
            (Some(pixel), Some(line)) => line.push(pixel),
            (None, Some(line)) if !line.is_empty() => lines.push(Vec::new()),
            _ => {}
        }
    }
    lines.retain(|line| line.len() > 1);
    lines
}

/// The corners of what a camera sees at a depth: top left, top right, bottom right, bottom left; in the scene.
pub fn corners(camera: &Camera, pose: &Pose, depth: f64) -> [DVec3; 4] {
    let [width, height] = [camera.width, camera.height].map(f64::from);
    let corners = [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]];
    corners.map(|pixel| at_depth(camera, pose, pixel, depth))
}

/// The point of the scene that is seen at a place of the picture, at a depth.
pub fn at_depth(camera: &Camera, pose: &Pose, [x, y]: [f64; 2], depth: f64) -> DVec3 {
    let ray = DVec3::new(
        (x - f64::from(camera.cx)) / f64::from(camera.fx),
        (y - f64::from(camera.cy)) / f64::from(camera.fy),
        1.0,
    );
    let inverse = pose.inverse();
    inverse.rotation * (ray * depth) + inverse.translation
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: Camera =
        Camera { width: 200, height: 100, fx: 100.0, fy: 100.0, cx: 100.0, cy: 50.0 };

    #[test]
    fn corners_are_seen_in_the_corners() {
        let pose = Pose::exp(&[0.3, -0.2, 0.5, 0.4, -0.1, 0.2]);
        let seen = corners(&CAMERA, &pose, 3.0).map(|point| project(&CAMERA, &pose, point, 0.1));
        assert_eq!(seen, [[0.0, 0.0], [200.0, 0.0], [200.0, 100.0], [0.0, 100.0]].map(Some));
    }

    #[test]
    fn lines_end_where_they_pass_behind_the_camera() {
        let depths = [1.0, 2.0, -1.0, f64::NAN, 3.0, 4.0, 5.0, -1.0, 6.0];
        let points = depths.map(|z| DVec3::new(0.0, 0.0, z));
        let found = lines(&CAMERA, &Pose::IDENTITY, points, 0.5);
        assert_eq!(found.iter().map(Vec::len).collect::<Vec<_>>(), [2, 3]);
    }
}
