//! Three planes of a picture's colours, as little alike as a rotation makes them.

use super::lifting::FRACTION;
use crate::coder_tables::PLANES;

/// Binary places of the rotation.
const PLACES: u32 = 14;

/// Rows: what each plane takes of red, green and blue. Orthonormal. The eigenvectors of the colours of the
/// difference pictures of the reef's training frames; their variances are about 380, 37 and 6.5.
const ROTATION: [[i32; PLANES]; PLANES] =
    [[9242, 10501, 8529], [12798, -3439, -9634], [4384, -12097, 10143]];

/// The planes of pixels that `value` gives, each a number of red, green and blue.
pub fn to_planes(value: impl Fn(usize) -> [i32; 3], planes: [&mut [i32]; PLANES]) {
    for (row, plane) in ROTATION.iter().zip(planes) {
        for (index, to) in plane.iter_mut().enumerate() {
            let rgb = value(index);
            let sum = row[0] * rgb[0] + row[1] * rgb[1] + row[2] * rgb[2];
            *to = (sum + (1 << (PLACES - FRACTION - 1))) >> (PLACES - FRACTION);
        }
    }
}

/// The planes of one pixel, of which red, green and blue have as many binary places.
pub fn fine_to_planes(rgb: [i32; 3]) -> [i32; PLANES] {
    ROTATION.map(|row| {
        let sum = row[0] * rgb[0] + row[1] * rgb[1] + row[2] * rgb[2];
        (sum + (1 << (PLACES - 1))) >> PLACES
    })
}

/// Red, green and blue of a pixel's three planes, rounded to whole levels.
pub fn to_rgb(planes: [i32; PLANES]) -> [i32; 3] {
    let places = PLACES + FRACTION;
    // Damaged input may make any number of a plane; a picture's lie far within this.
    let planes = planes.map(i64::from);
    std::array::from_fn(|channel| {
        let sum: i64 = (0..PLANES).map(|p| i64::from(ROTATION[p][channel]) * planes[p]).sum();
        let level = (sum + (1 << (places - 1))) >> places;
        level.clamp(-1024, 1024) as i32
    })
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
            let mut planes = [[0]; PLANES];
            let [a, b, c] = &mut planes;
            to_planes(|_| rgb, [a, b, c]);
            assert_eq!(to_rgb(planes.map(|p| p[0])), rgb);
        }
    }
}
