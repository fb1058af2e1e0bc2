//! Lenses: pinhole intrinsics with OpenCV's distortion, and pictures freed of it.
//!
//! **Axes and pixels.** Camera axes are OpenCV's: x right, y down, z forward. A ray is given by
//! (x/z, y/z). Pixel (0, 0) covers `[0, 1) × [0, 1)`, so its centre lies at (0.5, 0.5). COLMAP's
//! models, nerfstudio's `transforms.json` and `cameras.json` count pixels this way, and their
//! principal points are taken as they stand. OpenCV's own calibration puts pixel centres at
//! integers: add 0.5 to its `cx` and `cy` before they go into one of those files.
//!
//! **Formulas** are those of OpenCV's documentation, modules `calib3d` ("Detailed Description") and
//! `fisheye`; COLMAP's models of the same names are the same. Tangents are libm's, so that a lens is
//! the same on every machine.

mod footprint;

use glam::{DMat2, DVec2};

use super::{Camera, CameraError};

pub use footprint::Footprint;

/// Size and pinhole intrinsics of a picture, pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intrinsics {
    /// Picture width, pixels.
    pub width: u32,
    /// Picture height, pixels.
    pub height: u32,
    /// Focal length along x, pixels.
    pub fx: f64,
    /// Focal length along y, pixels.
    pub fy: f64,
    /// Principal point, x, pixels.
    pub cx: f64,
    /// Principal point, y, pixels.
    pub cy: f64,
}

/// What a lens does to a ray (x, y), with r² = x² + y².
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Distortion {
    /// Nothing.
    None,
    /// Brown-Conrady, OpenCV's order: k1, k2, p1, p2, k3, k4, k5, k6. With
    /// c = (1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶), x becomes
    /// c x + 2 p1 x y + p2 (r² + 2 x²), and y becomes c y + p1 (r² + 2 y²) + 2 p2 x y.
    Brown([f64; 8]),
    /// Kannala-Brandt, as in OpenCV's `fisheye`: k1 to k4. With θ = atan r, the ray's length becomes
    /// θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸).
    Fisheye([f64; 4]),
}

/// A lens whose values were checked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    intrinsics: Intrinsics,
    distortion: Distortion,
    /// Longest ray that is mapped; beyond it the picture would fold over itself.
    longest: f64,
    /// Whether it would fold nowhere in front of the camera.
    unfolded: bool,
    pinhole: Camera,
}

/// Why a lens, or a picture with it, cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Their texts tell.
pub enum LensError {
    #[error("lens for pictures of {width}×{height}: sides must lie in 1..={max}")]
    Side { width: u32, height: u32, max: u32 },
    #[error("lens {name} = {value}: must be finite, focal lengths positive")]
    Intrinsic { name: &'static str, value: f64 },
    #[error("distortion coefficient {value}: must be finite")]
    Coefficient { value: f64 },
    #[error("{found} distortion coefficients; OpenCV's lens has 4, 5 or 8 of them")]
    Count { found: usize },
    #[error(
        "principal point ({cx}, {cy}) lies outside of the picture; such a lens cannot be \
        undistorted"
    )]
    PrincipalPoint { cx: f64, cy: f64 },
    #[error(
        "the distortion folds the picture over itself about its middle; check the values of \
        its coefficients and their order"
    )]
    Folds,
    #[error(
        "the picture's corner ({x}, {y}) has no ray: nearer to the middle the distortion folds the \
        picture over itself; check the values of its coefficients and their order, fx and fy"
    )]
    NoRay { x: u32, y: u32 },
    #[error(
        "no pixel of the camera's picture shows anything of the lens's; check fx, fy, cx and cy of both"
    )]
    Nothing,
    #[error("the picture is {}×{}, its lens is for {}×{}", found.0, found.1, expected.0, expected.1)]
    Size { found: (u32, u32), expected: (u32, u32) },
    #[error(transparent)]
    Camera(#[from] CameraError),
}

/// Most that a corner of an undistorted picture looks aside, degrees. Beyond it a pinhole picture
/// gives most of its pixels to its edges.
const MAX_ANGLE: f64 = 70.0;

/// Largest angle for which a lens is checked, and the step of that check, degrees. At 90° a
/// pinhole's rays are infinite.
const SCAN: (f64, f64) = (89.95, 0.05);

/// Points on each side of a picture at which its edge is checked.
const EDGE_POINTS: u32 = 256;

/// Newton's steps for the ray of a pixel, and how close to the pixel they must come, pixels.
const STEPS: usize = 40;
const CLOSE: f64 = 1e-6;

impl Distortion {
    /// Brown-Conrady from 4, 5 or 8 coefficients in OpenCV's order: k1, k2, p1, p2, k3, k4, k5, k6.
    pub fn brown(coefficients: &[f64]) -> Result<Distortion, LensError> {
        let found = coefficients.len();
        if ![4, 5, 8].contains(&found) {
            return Err(LensError::Count { found });
        }
        let mut all = [0.0; 8];
        all[..found].copy_from_slice(coefficients);
        Ok(Distortion::Brown(all))
    }

    fn check(&self) -> Result<(), LensError> {
        let coefficients: &[f64] = match self {
            Distortion::None => &[],
            Distortion::Brown(k) => k,
            Distortion::Fisheye(k) => k,
        };
        match coefficients.iter().find(|value| !value.is_finite()) {
            Some(&value) => Err(LensError::Coefficient { value }),
            None => Ok(()),
        }
    }

    /// The factor by which a ray of this length grows, tangential terms left out.
    fn factor(&self, length: f64) -> f64 {
        match self {
            Distortion::None => 1.0,
            Distortion::Brown([k1, k2, _, _, k3, k4, k5, k6]) => {
                let s = length * length;
                let over = 1.0 + s * (k1 + s * (k2 + s * k3));
                let under = 1.0 + s * (k4 + s * (k5 + s * k6));
                // Beyond a pole both may be negative.
                if under > 0.0 { over / under } else { f64::NAN }
            }
            Distortion::Fisheye([k1, k2, k3, k4]) => {
                let angle = libm::atan(length);
                let s = angle * angle;
                let bent = angle * (1.0 + s * (k1 + s * (k2 + s * (k3 + s * k4))));
                if length > 0.0 { bent / length } else { 1.0 }
            }
        }
    }

    fn apply(&self, ray: DVec2) -> DVec2 {
        let radial = ray * self.factor(ray.length());
        let Distortion::Brown([_, _, p1, p2, ..]) = self else { return radial };
        let (s, xy) = (ray.length_squared(), ray.x * ray.y);
        let x = 2.0 * p1 * xy + p2 * (s + 2.0 * ray.x * ray.x);
        let y = p1 * (s + 2.0 * ray.y * ray.y) + 2.0 * p2 * xy;
        radial + DVec2::new(x, y)
    }

    /// How the distorted ray changes with the ray.
    fn slope(&self, ray: DVec2) -> DMat2 {
        let small = 1e-6 * ray.length().max(1e-3);
        let along = |step: DVec2| (self.apply(ray + step) - self.apply(ray - step)) / (2.0 * small);
        DMat2::from_cols(along(DVec2::X * small), along(DVec2::Y * small))
    }

    /// The longest ray up to which longer rays stay longer; 0 if there is none. Then whether that is as far aside as a
    /// pinhole's rays go.
    fn longest_ray(&self) -> (f64, bool) {
        let (end, step) = SCAN;
        let (mut longest, mut reached) = (0.0, 0.0);
        for i in 1..=(end / step) as u32 {
            let length = libm::tan((f64::from(i) * step).to_radians());
            let bent = length * self.factor(length);
            // A NaN ends it, too.
            if !(bent > reached && bent.is_finite()) {
                return (longest, false);
            }
            (longest, reached) = (length, bent);
        }
        (longest, true)
    }
}

/// Not inlined: compilers compare the coefficients before they look at the variant, harmlessly, and memory checkers
/// then report those that a fisheye does not have.
#[inline(never)]
fn are_zero(coefficients: &[f64; 8]) -> bool {
    coefficients.iter().all(|value| *value == 0.0)
}

impl Lens {
    /// Largest picture side, pixels.
    pub const MAX_SIDE: u32 = 65_535;

    /// Checks the values. Brown-Conrady with all coefficients zero becomes [`Distortion::None`].
    pub fn new(intrinsics: Intrinsics, distortion: Distortion) -> Result<Lens, LensError> {
        check_intrinsics(&intrinsics)?;
        distortion.check()?;
        let none = matches!(&distortion, Distortion::Brown(k) if are_zero(k));
        let distortion = if none { Distortion::None } else { distortion };
        let (longest, unfolded) = distortion.longest_ray();
        if longest == 0.0 {
            return Err(LensError::Folds);
        }
        let pinhole = camera(&intrinsics, 1.0);
        let mut lens = Lens { intrinsics, distortion, longest, unfolded, pinhole };
        if distortion != Distortion::None {
            let Intrinsics { cx, cy, .. } = intrinsics;
            if !lens.shows(DVec2::new(cx, cy), 0.0) {
                return Err(LensError::PrincipalPoint { cx, cy });
            }
            lens.pinhole = camera(&intrinsics, lens.focal_factor().ok_or(LensError::Folds)?);
        }
        Camera { width: 1, height: 1, ..lens.pinhole }.check()?;
        Ok(lens)
    }

    /// Its size and pinhole intrinsics.
    pub fn intrinsics(&self) -> &Intrinsics {
        &self.intrinsics
    }

    /// Width and height of its pictures, pixels.
    pub fn size(&self) -> (u32, u32) {
        (self.intrinsics.width, self.intrinsics.height)
    }

    /// Its distortion.
    pub fn distortion(&self) -> &Distortion {
        &self.distortion
    }

    /// Where a ray (x/z, y/z) meets the picture's plane, pixels; it may lie outside of the picture.
    /// `None` if the ray is so far aside that the model folds the picture over itself.
    pub fn distort(&self, ray: DVec2) -> Option<DVec2> {
        // A NaN is refused, too.
        if !(ray.length() <= self.longest) {
            return None;
        }
        let Intrinsics { fx, fy, cx, cy, .. } = self.intrinsics;
        let pixel = self.distortion.apply(ray) * DVec2::new(fx, fy) + DVec2::new(cx, cy);
        pixel.is_finite().then_some(pixel)
    }

    /// The ray that meets the picture's plane at a pixel, by Newton's method. `None` if there is none, or if the method
    /// does not find it.
    pub fn ray(&self, pixel: DVec2) -> Option<DVec2> {
        let Intrinsics { fx, fy, cx, cy, .. } = self.intrinsics;
        let wanted = (pixel - DVec2::new(cx, cy)) / DVec2::new(fx, fy);
        let mut ray =
            wanted * (self.undistorted_length(wanted.length())? / wanted.length().max(1e-300));
        for _ in 0..STEPS {
            let rest = wanted - self.distortion.apply(ray);
            if (rest * DVec2::new(fx, fy)).length() < CLOSE {
                break;
            }
            ray += self.distortion.slope(ray).inverse() * rest;
        }
        let found = self.distort(ray)?;
        ((found - pixel).length() < CLOSE).then_some(ray)
    }

    /// The length of the ray that becomes one of this length, tangential terms left out, by halving; `None` if it is
    /// longer than all that are mapped.
    fn undistorted_length(&self, wanted: f64) -> Option<f64> {
        let (mut low, mut high) = (0.0, self.longest);
        if !(high * self.distortion.factor(high) >= wanted) {
            return None;
        }
        for _ in 0..100 {
            let middle = 0.5 * (low + high);
            if middle * self.distortion.factor(middle) < wanted {
                low = middle
            } else {
                high = middle
            }
        }
        Some(high)
    }

    /// Refuses a lens that folds the picture over itself within the picture: one of its corners has no ray. A fisheye's
    /// corners may look more than a right angle aside; then they need no ray.
    pub fn check_corners(&self) -> Result<(), LensError> {
        let Intrinsics { width, height, .. } = self.intrinsics;
        for (x, y) in [(0, 0), (width, 0), (0, height), (width, height)] {
            if !self.unfolded && self.ray(DVec2::new(x.into(), y.into())).is_none() {
                return Err(LensError::NoRay { x, y });
            }
        }
        Ok(())
    }

    /// The camera of the undistorted pictures, at the size of the distorted ones.
    ///
    /// The principal point stays. Both focal lengths are multiplied by one factor: the least with
    /// which no pixel shows anything outside of the distorted picture, so that as much as possible
    /// of it is kept, and none of the camera's corners looks more than 70° aside. Without
    /// distortion it is the lens itself. It may be larger than [`Camera::MAX_SIDE`].
    pub fn pinhole(&self) -> Camera {
        self.pinhole
    }

    /// [`Lens::pinhole`] at this width, if that is less than its own; the height is rounded.
    pub fn pinhole_at(&self, width: u32) -> Camera {
        let own = self.pinhole;
        if width == 0 || own.width <= width {
            return own;
        }
        let height = f64::from(own.height) * f64::from(width) / f64::from(own.width);
        own.resized(width, (height.round() as u32).max(1))
    }

    /// The same lens for pictures of another size: intrinsics scale with the sides.
    pub fn resized(&self, width: u32, height: u32) -> Result<Lens, LensError> {
        let own = self.intrinsics;
        let sx = f64::from(width) / f64::from(own.width);
        let sy = f64::from(height) / f64::from(own.height);
        let (fx, fy, cx, cy) = (own.fx * sx, own.fy * sy, own.cx * sx, own.cy * sy);
        let intrinsics = Intrinsics { width, height, fx, fy, cx, cy };
        check_intrinsics(&intrinsics)?;
        Ok(Lens { intrinsics, pinhole: self.pinhole.resized(width, height), ..*self })
    }

    /// Whether a picture of this lens needs no more than another size to be one of the camera.
    pub fn is_only_resized(&self, to: &Camera) -> bool {
        let own = self.pinhole.resized(to.width, to.height);
        let close = |a: f32, b: f32| (a - b).abs() <= 1e-5 * a.abs().max(b.abs());
        let same = close(own.fx, to.fx) && close(own.fy, to.fy);
        self.distortion == Distortion::None && same && close(own.cx, to.cx) && close(own.cy, to.cy)
    }

    /// Whether a point lies on the picture, or off it by no more than `slack`.
    fn shows(&self, pixel: DVec2, slack: f64) -> bool {
        let end = DVec2::new(self.intrinsics.width.into(), self.intrinsics.height.into());
        pixel.cmpge(DVec2::splat(-slack)).all() && pixel.cmple(end + slack).all()
    }

    /// The factor of [`Lens::pinhole`], by halving; `None` if no factor will do.
    fn focal_factor(&self) -> Option<f64> {
        let edge = self.edge_rays();
        let fits = |factor: f64| {
            edge.iter().all(|ray| self.distort(*ray / factor).is_some_and(|p| self.shows(p, 0.0)))
        };
        let widest = self.longest.min(libm::tan(MAX_ANGLE.to_radians()));
        let longest = edge.iter().map(|ray| ray.length()).fold(0.0, f64::max);
        // A little more than needed, for the camera's rounding to f32.
        let mut low = longest / widest * (1.0 + 1e-6);
        if fits(low) {
            return Some(low);
        }
        let mut high = low;
        for _ in 0..40 {
            high *= 2.0;
            if fits(high) {
                break;
            }
            low = high;
        }
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            if fits(middle) { high = middle } else { low = middle }
        }
        fits(high).then_some(high)
    }

    /// Rays through points on the edge of the picture, as of the pinhole without a factor.
    fn edge_rays(&self) -> Vec<DVec2> {
        let Intrinsics { width, height, fx, fy, cx, cy } = self.intrinsics;
        let end = DVec2::new(width.into(), height.into());
        let points = (0..=EDGE_POINTS).flat_map(|i| {
            let at = f64::from(i) / f64::from(EDGE_POINTS);
            let near = [DVec2::new(at, 0.0), DVec2::new(0.0, at)];
            [near[0], near[1], 1.0 - near[0], 1.0 - near[1]]
        });
        points.map(|p| (p * end - DVec2::new(cx, cy)) / DVec2::new(fx, fy)).collect()
    }
}

fn check_intrinsics(intrinsics: &Intrinsics) -> Result<(), LensError> {
    let Intrinsics { width, height, fx, fy, cx, cy } = *intrinsics;
    let sides = 1..=Lens::MAX_SIDE;
    if !sides.contains(&width) || !sides.contains(&height) {
        return Err(LensError::Side { width, height, max: Lens::MAX_SIDE });
    }
    let bad_focal =
        [("fx", fx), ("fy", fy)].into_iter().find(|(_, v)| !(v.is_finite() && *v > 0.0));
    let mut centre = [("cx", cx), ("cy", cy)].into_iter();
    match bad_focal.or_else(|| centre.find(|(_, v)| !v.is_finite())) {
        Some((name, value)) => Err(LensError::Intrinsic { name, value }),
        None => Ok(()),
    }
}

/// The pinhole of these intrinsics, focal lengths times a factor.
fn camera(intrinsics: &Intrinsics, factor: f64) -> Camera {
    let Intrinsics { width, height, fx, fy, cx, cy } = *intrinsics;
    let [fx, fy, cx, cy] = [fx * factor, fy * factor, cx, cy].map(|v| v as f32);
    Camera { width, height, fx, fy, cx, cy }
}

#[cfg(test)]
mod tests;
