//! The camera frame, reduced by area averaging.

use crate::{Camera, Picture};

/// A frame at several sizes, as floats in [0, 1]. Buffers are kept from frame to frame.
pub struct Pyramid {
    width: u32,
    height: u32,
    levels: Vec<Level>,
}

struct Level {
    factor: u32,
    width: u32,
    height: u32,
    rgb: Vec<f32>,
}

impl Pyramid {
    /// For frames of a camera's size, at these reduction factors. Levels without a pixel are left
    /// out, as by the renderer.
    pub fn new(camera: &Camera, factors: &[u32]) -> Pyramid {
        let levels = factors
            .iter()
            .map(|&factor| (factor, camera.reduced(factor)))
            .filter(|(_, c)| c.width > 0 && c.height > 0)
            .map(|(factor, c)| Level {
                factor,
                width: c.width,
                height: c.height,
                rgb: vec![0.0; c.pixels() * 3],
            })
            .collect();
        Pyramid { width: camera.width, height: camera.height, levels }
    }

    /// Averages a frame over blocks of each level's factor.
    ///
    /// # Panics
    /// If the frame's size is not the camera's.
    pub fn set(&mut self, frame: &Picture) {
        assert_eq!((frame.width, frame.height), (self.width, self.height), "frame size");
        for level in &mut self.levels {
            level.fill(frame);
        }
    }

    /// Floats of a level: height × width × 3.
    pub fn level(&self, level: usize) -> &[f32] {
        &self.levels[level].rgb
    }
}

impl Level {
    fn fill(&mut self, frame: &Picture) {
        let (f, stride) = (self.factor as usize, frame.width as usize * 3);
        let scale = 1.0 / (255.0 * (f * f) as f32);
        let width = self.width as usize;
        for (i, to) in self.rgb.iter_mut().enumerate().take(width * self.height as usize * 3) {
            let (channel, x, y) = (i % 3, i / 3 % width, i / 3 / width);
            let first = y * f * stride + x * f * 3 + channel;
            let sum: u32 = (0..f)
                .flat_map(|row| (0..f).map(move |column| first + row * stride + column * 3))
                .map(|at| u32::from(frame.data[at]))
                .sum();
            *to = sum as f32 * scale;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn averages_whole_blocks() {
        let camera = Camera { width: 5, height: 4, fx: 4.0, fy: 4.0, cx: 2.5, cy: 2.0 };
        let mut frame = Picture::new(5, 4);
        frame.data[0] = 255;
        frame.data[3 * 3 + 1] = 51;
        let mut pyramid = Pyramid::new(&camera, &[1, 2, 8]);
        pyramid.set(&frame);
        assert_eq!(pyramid.levels.len(), 2);
        assert_eq!(pyramid.level(0)[0], 1.0);
        assert_eq!(pyramid.level(1)[0], 0.25);
        assert!((pyramid.level(1)[4] - 0.05).abs() < 1e-7);
    }
}
