//! What each splat of an update is worth: the error that it takes off a frame that it was not learnt from.

use glam::{DMat3, DQuat, DVec2, DVec3};

use crate::Picture;
use crate::prior::LearntSplat;

use super::key_frame::KeyFrame;

/// How far a splat reaches, in standard deviations.
const REACH: f64 = 2.5;
/// Variance that every splat has in the picture, square pixels: as the renderer's.
const BLUR: f64 = 0.3;

/// A splat that an update adds or changes.
#[derive(Clone, Copy, Debug)]
pub struct Part {
    pub splat: LearntSplat,
    /// How much of it is new, 0 to 1.
    pub new: f64,
}

/// What parts are worth on a frame, bytes. A pixel's error that the renders `without` and `with` differ by is shared by
/// the parts that show there. `price`: bytes that a squared error of 1 takes, values up to 255.
pub fn worths(
    key: &KeyFrame,
    parts: &[Part],
    [without, with]: [&Picture; 2],
    price: f64,
) -> Vec<f64> {
    let prints: Vec<Option<Print>> = parts.iter().map(|part| Print::of(key, part)).collect();
    let mut cover = vec![0.0; key.camera.pixels()];
    for print in prints.iter().flatten() {
        print.each(key, |pixel, weight| cover[pixel] += weight);
    }
    let worth = |print: &Print| {
        let mut sum = 0.0;
        print.each(key, |pixel, weight| {
            let gain = key.error(without, pixel) - key.error(with, pixel);
            sum += price * gain * weight / cover[pixel];
        });
        sum
    };
    prints.iter().map(|print| print.as_ref().map_or(0.0, worth)).collect()
}

/// Where a splat shows in a frame: a Gaussian (Zwicker et al. 2001).
struct Print {
    middle: DVec2,
    /// Inverse covariance: xx, xy, yy.
    conic: [f64; 3],
    reach: DVec2,
    weight: f64,
}

impl Print {
    /// `None`: it does not show.
    fn of(key: &KeyFrame, part: &Part) -> Option<Print> {
        let LearntSplat { log_scale, rotation: [w, x, y, z], logit, .. } = part.splat;
        let centre = part.splat.centre();
        let ([px, py], depth) = key.seen(centre)?;
        let [fx, fy] = [key.camera.fx, key.camera.fy].map(f64::from);
        let p = key.pose.rotation * centre + key.pose.translation;
        let own = DQuat::from_xyzw(x.into(), y.into(), z.into(), w.into()).normalize();
        let scale = DVec3::from(log_scale.map(|v| f64::from(v).exp()));
        let axes = DMat3::from_quat(key.pose.rotation * own) * DMat3::from_diagonal(scale);
        let across = axes.transpose() * DVec3::new(fx / depth, 0.0, -fx * p.x / (depth * depth));
        let down = axes.transpose() * DVec3::new(0.0, fy / depth, -fy * p.y / (depth * depth));
        let (xx, xy, yy) = (across.dot(across) + BLUR, across.dot(down), down.dot(down) + BLUR);
        let scale = 1.0 / (xx * yy - xy * xy);
        let opacity = 1.0 / (1.0 + f64::from(-logit).exp());
        Some(Print {
            middle: DVec2::new(px, py),
            conic: [yy * scale, -xy * scale, xx * scale],
            reach: REACH * DVec2::new(xx.sqrt(), yy.sqrt()),
            weight: opacity * part.new,
        })
    }

    /// The pixels that it covers and count, and how much it shows there.
    fn each(&self, key: &KeyFrame, mut visit: impl FnMut(usize, f64)) {
        let end = DVec2::new(key.camera.width.into(), key.camera.height.into());
        let first = (self.middle - self.reach).clamp(DVec2::ZERO, end);
        let last = (self.middle + self.reach).clamp(DVec2::ZERO, end);
        for y in first.y as usize..last.y.ceil() as usize {
            for x in first.x as usize..last.x.ceil() as usize {
                let pixel = y * key.camera.width as usize + x;
                let d = DVec2::new(x as f64, y as f64) + 0.5 - self.middle;
                let [xx, xy, yy] = self.conic;
                let power = xx * d.x * d.x + 2.0 * xy * d.x * d.y + yy * d.y * d.y;
                let weight = self.weight * (-0.5 * power).exp();
                if weight > 1e-3 && key.counts(pixel) {
                    visit(pixel, weight);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::{Camera, Pose};

    use super::*;

    const CAMERA: Camera = Camera { width: 64, height: 48, fx: 60.0, fy: 60.0, cx: 32.0, cy: 24.0 };

    /// A splat at a pixel, one unit away, some pixels large.
    fn part_at([x, y]: [f32; 2]) -> Part {
        let position = [(x - CAMERA.cx) / CAMERA.fx, (y - CAMERA.cy) / CAMERA.fy, 1.0];
        let splat = LearntSplat {
            position,
            log_scale: [0.05_f32.ln(); 3],
            rotation: [1.0, 0.0, 0.0, 0.0],
            logit: 2.0,
            colour: [0.0; 3],
        };
        Part { splat, new: 1.0 }
    }

    fn grey(value: u8) -> Picture {
        let mut picture = Picture::new(CAMERA.width, CAMERA.height);
        picture.data.fill(value);
        picture
    }

    #[test]
    fn a_part_is_worth_the_error_it_takes_off() {
        let key = KeyFrame::new(0, &CAMERA, &Pose::IDENTITY, &grey(100), None);
        let (without, mut with) = (grey(90), grey(90));
        // The left half comes out right, the right half worse.
        for pixel in 0..CAMERA.pixels() {
            let value = if pixel % 64 < 32 { 100 } else { 70 };
            with.data[3 * pixel..3 * pixel + 3].fill(value);
        }
        let parts = [part_at([16.0, 24.0]), part_at([48.0, 24.0]), part_at([300.0, 24.0])];
        let found = worths(&key, &parts, [&without, &with], 0.01);
        assert!(found[0] > 0.0, "{found:?}");
        assert!(found[1] < 0.0, "{found:?}");
        assert_eq!(found[2], 0.0, "it does not show");
    }

    #[test]
    fn parts_share_what_they_show() {
        let key = KeyFrame::new(0, &CAMERA, &Pose::IDENTITY, &grey(100), None);
        let part = part_at([32.0, 24.0]);
        let alone = worths(&key, &[part], [&grey(90), &grey(100)], 0.01)[0];
        let half = Part { new: 0.5, ..part };
        let both = worths(&key, &[part, half], [&grey(90), &grey(100)], 0.01);
        assert!((both[0] - 2.0 * both[1]).abs() < 0.01 * alone, "{both:?} of {alone}");
        assert!((both[0] + both[1] - alone).abs() < 0.02 * alone, "{both:?} of {alone}");
    }

    #[test]
    fn a_long_splat_shows_along_its_length() {
        let key = KeyFrame::new(0, &CAMERA, &Pose::IDENTITY, &grey(100), None);
        let mut long = part_at([32.0, 24.0]);
        // A quarter turn about the camera's axis: its longest side lies down the picture.
        long.splat.log_scale = [0.2_f32.ln(), 0.01_f32.ln(), 0.01_f32.ln()];
        long.splat.rotation = [0.5_f32.sqrt(), 0.0, 0.0, 0.5_f32.sqrt()];
        let print = Print::of(&key, &long).expect("it shows");
        let (mut columns, mut rows) = (0..0, 0..0);
        print.each(&key, |pixel, _| {
            let (x, y) = (pixel % 64, pixel / 64);
            columns = if columns.is_empty() {
                x..x + 1
            } else {
                columns.start.min(x)..columns.end.max(x + 1)
            };
            rows = if rows.is_empty() { y..y + 1 } else { rows.start.min(y)..rows.end.max(y + 1) };
        });
        assert!(rows.len() > 5 * columns.len(), "{rows:?} {columns:?}");
    }
}
