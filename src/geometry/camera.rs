//! The pinhole camera.

use serde::{Deserialize, Serialize};

/// A pinhole camera without distortion, OpenCV axes: x right, y down, z forward. Pixel (0, 0)
/// covers `[0, 1) × [0, 1)`, so pixel centres lie at +0.5.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// Picture width, pixels.
    pub width: u32,
    /// Picture height, pixels.
    pub height: u32,
    /// Focal length along x, pixels.
    pub fx: f32,
    /// Focal length along y, pixels.
    pub fy: f32,
    /// Principal point, x, pixels.
    pub cx: f32,
    /// Principal point, y, pixels.
    pub cy: f32,
}

/// Why a camera cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Their texts tell.
pub enum CameraError {
    #[error("picture size {width}×{height}: sides must lie in 1..={}", Camera::MAX_SIDE)]
    Size { width: u32, height: u32 },
    #[error("camera {name} = {value}: must be finite, focal lengths positive")]
    Intrinsic { name: &'static str, value: f32 },
}

impl Camera {
    /// Largest picture side, in pixels: what twelve bits of a packet's header carry, plus one.
    pub const MAX_SIDE: u32 = 4096;

    /// Checks size and intrinsics.
    pub fn check(&self) -> Result<(), CameraError> {
        let sides = 1..=Self::MAX_SIDE;
        if !sides.contains(&self.width) || !sides.contains(&self.height) {
            return Err(CameraError::Size { width: self.width, height: self.height });
        }
        let focal = [("fx", self.fx), ("fy", self.fy)];
        let centre = [("cx", self.cx), ("cy", self.cy)];
        let bad_focal = focal.into_iter().find(|(_, v)| !(v.is_finite() && *v > 0.0));
        match bad_focal.or_else(|| centre.into_iter().find(|(_, v)| !v.is_finite())) {
            Some((name, value)) => Err(CameraError::Intrinsic { name, value }),
            None => Ok(()),
        }
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// The same view at another picture size: intrinsics scale with the sides.
    pub fn resized(&self, width: u32, height: u32) -> Camera {
        let (sx, sy) = (width as f32 / self.width as f32, height as f32 / self.height as f32);
        Camera {
            width,
            height,
            fx: self.fx * sx,
            fy: self.fy * sy,
            cx: self.cx * sx,
            cy: self.cy * sy,
        }
    }

    /// The same view, if it is wider than `width` pixels, at that width; 0: as it is.
    pub fn at_most_wide(&self, width: u32) -> Camera {
        if width == 0 || self.width <= width {
            return *self;
        }
        let height = f64::from(self.height) * f64::from(width) / f64::from(self.width);
        self.resized(width, (height.round() as u32).max(1))
    }

    /// The camera whose pixels are `factor × factor` blocks of this one's. Blocks that do not fit
    /// whole at the right and lower edge are left out, so that every pixel averages a full block.
    pub fn reduced(&self, factor: u32) -> Camera {
        let s = 1.0 / factor as f32;
        Camera {
            width: self.width / factor,
            height: self.height / factor,
            fx: self.fx * s,
            fy: self.fy * s,
            cx: self.cx * s,
            cy: self.cy * s,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: Camera =
        Camera { width: 320, height: 180, fx: 274.0, fy: 274.0, cx: 160.0, cy: 90.0 };

    #[test]
    fn refuses_what_cannot_be_rendered() {
        assert_eq!(CAMERA.check(), Ok(()));
        assert!(Camera { width: 0, ..CAMERA }.check().is_err());
        assert!(Camera { height: 4097, ..CAMERA }.check().is_err());
        assert!(Camera { fx: 0.0, ..CAMERA }.check().is_err());
        assert!(Camera { cy: f32::NAN, ..CAMERA }.check().is_err());
    }

    #[test]
    fn reduced_drops_partial_blocks() {
        let c = CAMERA.reduced(8);
        assert_eq!((c.width, c.height), (40, 22));
        assert_eq!((c.fx, c.cy), (274.0 / 8.0, 90.0 / 8.0));
    }
}
