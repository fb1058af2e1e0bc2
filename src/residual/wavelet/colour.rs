//! Three planes of a picture's colours, as little alike as a rotation makes them.

use super::geometry::Planes;
use super::lifting::FRACTION;
use crate::coder_tables::PLANES;

/// Binary places of the rotation.
const PLACES: u32 = 14;

/// Rows: what each plane takes of red, green and blue. Orthonormal. The eigenvectors of the colours of the
/// difference pictures of the reef's training frames; their variances are about 380, 37 and 6.5.
const ROTATION: [[i32; PLANES]; PLANES] =
    [[9242, 10501, 8529], [12798, -3439, -9634], [4384, -12097, 10143]];

/// Writes the planes of pixels, each a number of red, green and blue.
pub fn to_planes(pixels: impl Iterator<Item = [i32; 3]>, planes: &mut Planes) {
    let [a, b, c] = planes;
    let planes = a.iter_mut().zip(b).zip(c);
    for (rgb, ((a, b), c)) in pixels.zip(planes) {
        [*a, *b, *c] = rotated(rgb, PLACES - FRACTION);
    }
}

/// Rotates a pixel, and takes off so many binary places.
fn rotated(rgb: [i32; 3], places: u32) -> [i32; PLANES] {
    ROTATION.map(|row| {
        let sum = row[0] * rgb[0] + row[1] * rgb[1] + row[2] * rgb[2];
        (sum + (1 << (places - 1))) >> places
    })
}

/// The planes of one pixel, of which red, green and blue have as many binary places.
pub fn fine_to_planes(rgb: [i32; 3]) -> [i32; PLANES] {
    rotated(rgb, PLACES)
}

/// Red, green and blue of pixels' three planes, rounded to whole levels.
pub fn to_rgb<const N: usize>(planes: &[[i32; N]; PLANES]) -> [[i32; N]; 3] {
    const TAKEN: u32 = PLACES + FRACTION;
    const HALF: i32 = 1 << (TAKEN - 1);
    let is_small = |value: &i32| i32::from(*value as i16) == *value;
    // A picture's planes are small, and products of small numbers are fast. Damaged input may make any number.
    if planes.as_flattened().iter().fold(true, |all, value| all & is_small(value)) {
        let level = |channel: usize, i: usize| {
            let product = |p: usize| ROTATION[p][channel] * i32::from(planes[p][i] as i16);
            (product(0) + product(1) + product(2) + HALF) >> TAKEN
        };
        return std::array::from_fn(|channel| std::array::from_fn(|i| level(channel, i)));
    }
    let level = |channel: usize, i: usize| {
        let product = |p: usize| i64::from(ROTATION[p][channel]) * i64::from(planes[p][i]);
        let level = (product(0) + product(1) + product(2) + i64::from(HALF)) >> TAKEN;
        level.clamp(-1024, 1024) as i32
    };
    std::array::from_fn(|channel| std::array::from_fn(|i| level(channel, i)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rotation_is_orthonormal() {
        for (i, a) in ROTATION.iter().enumerate() {
            for (j, b) in ROTATION.iter().enumerate() {
                let product: i32 = a.iter().zip(b).map(|(a, b)| a * b).sum();
                let one = 1 << (2 * PLACES);
                let due = if i == j { one } else { 0 };
                assert!((product - due).abs() < one / 8000, "{i} {j}: {product}");
            }
        }
    }

    #[test]
    fn colours_come_back() {
        for rgb in [[0, 0, 0], [255, -255, 255], [1, 2, -3], [-128, 90, 17]] {
            let mut planes: Planes = std::array::from_fn(|_| vec![0]);
            to_planes([rgb].into_iter(), &mut planes);
            assert_eq!(to_rgb(&planes.map(|plane| [plane[0]])).map(|[level]| level), rgb);
        }
    }
}
