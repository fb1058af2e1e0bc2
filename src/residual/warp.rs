//! A reference's difference picture, moved to where it shows in another view.
//!
//! Both sides do this, so all of it is portable: sums, products and quotients of f64, which every processor rounds in
//! the same way, then integers.

pub use crate::search::Placement;
use crate::{Camera, Picture};

use super::wavelet::sub_pixel::{PLACES, SubPixel, sample};
use super::wavelet::{Planes, colour};

/// Where a picture was seen from, in numbers that are the same on every device.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewpoint {
    /// The camera.
    pub camera: Camera,
    /// Its pose, as packets carry it.
    pub placement: Placement,
}

/// Nearer than this nothing is seen, the prior's unit.
const NEAREST: f64 = 1e-3;

/// How pixels of one view move to places in another.
struct Motion {
    /// Rows of the rotation, and the translation.
    rows: [[f64; 3]; 3],
    translation: [f64; 3],
    focal: [f64; 2],
    principal: [f64; 2],
}

impl Motion {
    fn new(from: &Viewpoint, to: &Viewpoint) -> Motion {
        let (a, b) = (matrix(&from.placement), matrix(&to.placement));
        let dot = |u: [f64; 3], v: [f64; 3]| u[0] * v[0] + u[1] * v[1] + u[2] * v[2];
        // X_to = B X + t_b and X_from = A X + t_a, so X_from = A Bᵀ (X_to − t_b) + t_a.
        let rows = a.map(|row| [dot(row, b[0]), dot(row, b[1]), dot(row, b[2])]);
        let [t_from, t_to] = [from, to].map(|v| v.placement.translation.map(f64::from));
        let turned = rows.map(|row| dot(row, t_to));
        let translation = [t_from[0] - turned[0], t_from[1] - turned[1], t_from[2] - turned[2]];
        let Camera { fx, fy, cx, cy, .. } = to.camera;
        let (focal, principal) = ([fx, fy].map(f64::from), [cx, cy].map(f64::from));
        Motion { rows, translation, focal, principal }
    }

    /// Where a pixel of the view, at a depth, lies among the other view's pixels: its first whole column and row,
    /// counted from pixel centres, and the parts beyond. `None` if it is not seen there.
    fn place(&self, x: usize, y: usize, depth: f32, size: (usize, usize)) -> Option<SubPixel> {
        let [[fx, fy], [cx, cy]] = [self.focal, self.principal];
        let depth = f64::from(depth);
        let point = [(x as f64 + 0.5 - cx) / fx * depth, (y as f64 + 0.5 - cy) / fy * depth, depth];
        let [px, py, pz] = std::array::from_fn(|i| {
            let row = self.rows[i];
            row[0] * point[0] + row[1] * point[1] + row[2] * point[2] + self.translation[i]
        });
        // Numbers that are none are not seen either.
        if !(pz > NEAREST) {
            return None;
        }
        let column = part_of(px / pz * fx + cx - 0.5, size.0)?;
        let row = part_of(py / pz * fy + cy - 0.5, size.1)?;
        Some(SubPixel { column, row })
    }
}

/// A coordinate as whole pixels and the part beyond. `None` if it lies outside.
fn part_of(coordinate: f64, len: usize) -> Option<(isize, usize)> {
    if !(coordinate > -0.5 && coordinate < len as f64 - 0.5) {
        return None;
    }
    // Above zero, where a conversion rounds down.
    let places = ((coordinate + 1.0) * PLACES as f64 + 0.5) as usize;
    Some(((places / PLACES) as isize - 1, places % PLACES))
}

/// A placement's rotation, by rows.
fn matrix(placement: &Placement) -> [[f64; 3]; 3] {
    let [w, x, y, z] = placement.rotation.map(f64::from);
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

/// Writes the planes of a difference picture that was seen from `from`, as they show from `to`, whose pixels have
/// `depths`. What was not seen is zero.
///
/// # Panics
/// If the difference has not the size of both cameras, or there are fewer depths than pixels.
pub fn warp(
    difference: &Picture,
    from: &Viewpoint,
    to: &Viewpoint,
    depths: &[f32],
    into: &mut Planes,
) {
    let Camera { width, height, .. } = to.camera;
    assert_eq!((difference.width, difference.height), (width, height), "size of the reference");
    let (width, height) = (width as usize, height as usize);
    let motion = Motion::new(from, to);
    for (y, depths) in depths.chunks(width).enumerate().take(height) {
        for (x, depth) in depths.iter().enumerate() {
            let rgb = match motion.place(x, y, *depth, (width, height)) {
                Some(place) => sample(difference, &place),
                None => [0; 3],
            };
            for (plane, value) in into.iter_mut().zip(colour::fine_to_planes(rgb)) {
                plane[y * width + x] = value;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::wavelet::sub_pixel::NONE;
    use super::*;

    fn camera() -> Camera {
        Camera { width: 40, height: 24, fx: 30.0, fy: 31.0, cx: 20.5, cy: 11.5 }
    }

    fn viewpoint(rotation: [f32; 4], translation: [f32; 3]) -> Viewpoint {
        Viewpoint { camera: camera(), placement: Placement { rotation, translation } }
    }

    fn planes() -> Planes {
        std::array::from_fn(|_| vec![7; 40 * 24])
    }

    /// A smooth difference picture.
    fn picture() -> Picture {
        let mut picture = Picture::new(40, 24);
        for (i, rgb) in picture.data.chunks_exact_mut(3).enumerate() {
            let (x, y) = ((i % 40) as i32, (i / 40) as i32);
            rgb.copy_from_slice(&[100 + 2 * x, 150 - 3 * y, 128 + x - y].map(|v| v as u8));
        }
        picture
    }

    #[test]
    fn the_same_view_gives_the_same_picture() {
        let here = viewpoint([0.6, 0.0, 0.8, 0.0], [3.0, -1.0, 2.0]);
        let (picture, mut warped, mut plain) = (picture(), planes(), planes());
        warp(&picture, &here, &here, &[4.0; 40 * 24], &mut warped);
        let pixels = picture.data.as_chunks::<3>().0.iter();
        colour::to_planes(pixels.map(|rgb| rgb.map(|level| i32::from(level) - NONE)), &mut plain);
        for (warped, plain) in warped.iter().flatten().zip(plain.iter().flatten()) {
            // Rotations are unit quaternions to f32's rounding.
            assert!((warped - plain).abs() <= 3, "{warped} {plain}");
        }
    }

    #[test]
    fn a_step_sideways_shifts_by_the_parallax() {
        // The camera of the new view stands 0.4 to the right: what it sees lay 0.4 · 30 / 4 = 3 pixels further right
        // before.
        let (before, now) = (viewpoint([1.0, 0.0, 0.0, 0.0], [0.0; 3]), [1.0, 0.0, 0.0, 0.0]);
        let now = viewpoint(now, [-0.4, 0.0, 0.0]);
        let (picture, mut warped, mut still) = (picture(), planes(), planes());
        warp(&picture, &before, &now, &[4.0; 40 * 24], &mut warped);
        warp(&picture, &before, &before, &[4.0; 40 * 24], &mut still);
        for y in 0..24 {
            for x in 0..36 {
                let (found, due) = (warped[0][y * 40 + x], still[0][y * 40 + x + 3]);
                assert!((found - due).abs() <= 2, "{x} {y}: {found} {due}");
            }
            assert_eq!(warped[0][y * 40 + 38], 0, "nothing was seen there");
        }
    }

    #[test]
    fn any_numbers_give_a_picture() {
        let odd = [f32::NAN, f32::INFINITY, -1.0, 0.0, f32::MAX, 1e-30, 5.0];
        let depths: Vec<f32> = (0..40 * 24).map(|i| odd[i % odd.len()]).collect();
        let mut into = planes();
        for value in odd {
            let far = viewpoint([1.0, 0.0, value, 0.0], [value, 0.0, 1.0]);
            let here = viewpoint([1.0, 0.0, 0.0, 0.0], [0.0; 3]);
            warp(&picture(), &far, &here, &depths, &mut into);
            warp(&picture(), &here, &far, &depths, &mut into);
        }
    }
}
