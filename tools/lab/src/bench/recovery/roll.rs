//! Frames as a camera rolled about its principal point would have taken them.

use nvsprior::{Camera, Picture, Pose};

/// Rolls the picture. Also returns which pixels show the clean picture: the others come in at the corners and have the
/// mean colour.
pub fn picture(camera: &Camera, clean: &Picture, angle: f64) -> (Picture, Vec<bool>) {
    let mean = mean(clean);
    let [fx, fy, cx, cy] = [camera.fx, camera.fy, camera.cx, camera.cy].map(f64::from);
    let (sin, cos) = angle.sin_cos();
    let mut rolled = Picture::new(clean.width, clean.height);
    let mut shown = Vec::new();
    for (index, pixel) in rolled.data.chunks_exact_mut(3).enumerate() {
        let (column, row) = (index % clean.width as usize, index / clean.width as usize);
        // The ray of the pixel's centre, turned back.
        let (x, y) = ((column as f64 + 0.5 - cx) / fx, (row as f64 + 0.5 - cy) / fy);
        let (u, v) = (fx * (cos * x + sin * y) + cx, fy * (cos * y - sin * x) + cy);
        let sampled = sample(clean, u, v);
        shown.push(sampled.is_some());
        let values = sampled.unwrap_or(mean);
        for (value, sampled) in pixel.iter_mut().zip(values) {
            *value = sampled.round() as u8;
        }
    }
    (rolled, shown)
}

/// The pose from which the rolled picture was taken.
pub fn pose(pose: &Pose, angle: f64) -> Pose {
    pose.stepped(&[0.0, 0.0, 0.0, 0.0, 0.0, angle])
}

/// The colour at a point, bilinear between pixel centres; `None` outside the picture.
fn sample(picture: &Picture, u: f64, v: f64) -> Option<[f64; 3]> {
    let (width, height) = (f64::from(picture.width), f64::from(picture.height));
    if !((0.0..=width).contains(&u) && (0.0..=height).contains(&v)) {
        return None;
    }
    let (x, y) = ((u - 0.5).clamp(0.0, width - 1.0), (v - 0.5).clamp(0.0, height - 1.0));
    let (left, top) = (x as usize, y as usize);
    let (right, low) =
        ((left + 1).min(picture.width as usize - 1), (top + 1).min(picture.height as usize - 1));
    let (across, down) = (x.fract(), y.fract());
    Some(std::array::from_fn(|channel| {
        let at = |column: usize, row: usize| {
            f64::from(picture.data[(row * picture.width as usize + column) * 3 + channel])
        };
        let line = |row| at(left, row) * (1.0 - across) + at(right, row) * across;
        line(top) * (1.0 - down) + line(low) * down
    }))
}

fn mean(picture: &Picture) -> [f64; 3] {
    let pixels = (picture.data.len() / 3) as f64;
    std::array::from_fn(|channel| {
        let values = picture.data.iter().skip(channel).step_by(3);
        values.map(|v| f64::from(*v)).sum::<f64>() / pixels
    })
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, PI};

    use super::*;

    const CAMERA: Camera = Camera { width: 4, height: 4, fx: 5.0, fy: 5.0, cx: 2.0, cy: 2.0 };

    fn ramp() -> Picture {
        Picture::from_rgb(4, 4, (0..48).map(|v| v * 5).collect()).unwrap()
    }

    fn at(picture: &Picture, column: usize, row: usize) -> &[u8] {
        &picture.data[(row * 4 + column) * 3..][..3]
    }

    #[test]
    fn quarter_turns_carry_pixels_over_as_the_pose_carries_points() {
        let clean = ramp();
        assert_eq!(picture(&CAMERA, &clean, 0.0), (clean.clone(), vec![true; 16]));
        let (half, _) = picture(&CAMERA, &clean, PI);
        assert_eq!(at(&half, 0, 0), at(&clean, 3, 3));
        // A point to the right of the camera's axis moves to below it, as y is down.
        let (quarter, _) = picture(&CAMERA, &clean, FRAC_PI_2);
        assert_eq!(at(&quarter, 2, 3), at(&clean, 3, 1));
        let rolled = pose(&Pose::IDENTITY, FRAC_PI_2);
        let point = rolled.rotation * glam::DVec3::new(1.0, 0.0, 2.0) + rolled.translation;
        assert!((point - glam::DVec3::new(0.0, 1.0, 2.0)).length() < 1e-12, "{point}");
    }

    #[test]
    fn corners_that_show_nothing_have_the_mean_colour() {
        let clean = ramp();
        let (rolled, shown) = picture(&CAMERA, &clean, 0.25 * PI);
        assert_eq!(at(&rolled, 0, 0), mean(&clean).map(|v| v.round() as u8));
        assert_ne!(at(&rolled, 1, 1), at(&rolled, 0, 0));
        assert!(!shown[0] && shown[5]);
    }
}
