//! Frames that are kept to learn from, and to judge by.

use glam::DVec3;

use crate::image::Mask;
use crate::{Camera, Picture, Pose};

use super::blur::blurred;

/// A frame whose pose is certain.
pub struct KeyFrame {
    pub number: u32,
    pub camera: Camera,
    pub pose: Pose,
    /// As it was treated. Masked pixels show the render.
    pub picture: Picture,
    /// See [`blurred`].
    pub blurred: Vec<[f32; 3]>,
    /// Which pixels count; `None`: all do.
    pub mask: Option<Mask>,
}

impl KeyFrame {
    pub fn new(
        number: u32,
        camera: &Camera,
        pose: &Pose,
        picture: &Picture,
        mask: Option<&Mask>,
    ) -> KeyFrame {
        KeyFrame {
            number,
            camera: *camera,
            pose: *pose,
            picture: picture.clone(),
            blurred: blurred(picture),
            mask: mask.cloned(),
        }
    }

    /// Whether a pixel counts.
    pub fn counts(&self, pixel: usize) -> bool {
        self.mask.as_ref().is_none_or(|mask| mask.data[pixel])
    }

    /// The point of the world at a depth along the ray of a place in the picture.
    pub fn point(&self, [x, y]: [f64; 2], depth: f64) -> DVec3 {
        let Camera { fx, fy, cx, cy, .. } = self.camera;
        let ray = DVec3::new(
            (x - f64::from(cx)) / f64::from(fx),
            (y - f64::from(cy)) / f64::from(fy),
            1.0,
        );
        self.pose.rotation.conjugate() * (ray * depth - self.pose.translation)
    }

    /// Where a point of the world shows, pixels, and its depth; `None`: behind the camera.
    pub fn seen(&self, point: DVec3) -> Option<([f64; 2], f64)> {
        let p = self.pose.rotation * point + self.pose.translation;
        let Camera { fx, fy, cx, cy, .. } = self.camera;
        (p.z > 1e-3).then(|| {
            let x = p.x / p.z * f64::from(fx) + f64::from(cx);
            let y = p.y / p.z * f64::from(fy) + f64::from(cy);
            ([x, y], p.z)
        })
    }

    /// The pixel that a point of the world shows in, column and row; `None`: beyond the picture.
    pub fn pixel_of(&self, point: DVec3) -> Option<[usize; 2]> {
        let ([x, y], _) = self.seen(point)?;
        let (width, height) = (f64::from(self.camera.width), f64::from(self.camera.height));
        let inside = (0.0..width).contains(&x) && (0.0..height).contains(&y);
        inside.then_some([x as usize, y as usize])
    }

    /// Colour between pixels, 0 to 255; `None` beyond the picture.
    pub fn colour_at(&self, [x, y]: [f64; 2]) -> Option<[f32; 3]> {
        let (width, height) = (self.camera.width as usize, self.camera.height as usize);
        let (x, y) = ((x - 0.5) as f32, (y - 0.5) as f32);
        if !(x >= 0.0 && y >= 0.0) {
            return None;
        }
        let (column, row) = (x as usize, y as usize);
        if column + 1 >= width || row + 1 >= height {
            return None;
        }
        let (u, v) = (x - column as f32, y - row as f32);
        let at = |column: usize, row: usize, c: usize| {
            f32::from(self.picture.data[3 * (row * width + column) + c])
        };
        let mix = |c: usize| {
            let upper = at(column, row, c) * (1.0 - u) + at(column + 1, row, c) * u;
            let lower = at(column, row + 1, c) * (1.0 - u) + at(column + 1, row + 1, c) * u;
            upper * (1.0 - v) + lower * v
        };
        Some([mix(0), mix(1), mix(2)])
    }

    /// Mean squared error of a pixel of a render, values up to 255.
    pub fn error(&self, render: &Picture, pixel: usize) -> f64 {
        let values = |picture: &Picture| [0, 1, 2].map(|c| f64::from(picture.data[3 * pixel + c]));
        let (a, b) = (values(&self.picture), values(render));
        (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f64>() / 3.0
    }
}
