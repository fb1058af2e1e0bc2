//! Effects of water, light and dirt on a picture. Random, but the same for the same seed.

use image::Rgb32FImage;
use imageproc::filter::gaussian_blur_f32;
use nvsprior::{Camera, Picture};

use super::super::perturbed::even;

const SPECKS: usize = 60;

/// Every value (0 to 255) by its column and row.
fn map(picture: &Picture, value: impl Fn(usize, usize, f64) -> f64) -> Picture {
    let Picture { width, height, data } = picture;
    let across = *width as usize;
    let at = |(index, old): (usize, &u8)| {
        let pixel = index / 3;
        value(pixel % across, pixel / across, f64::from(*old)).round() as u8
    };
    Picture { width: *width, height: *height, data: data.iter().enumerate().map(at).collect() }
}

/// `gain · value + offset`, values in [0, 1].
pub fn light(picture: &Picture, gain: f64, offset: f64) -> Picture {
    map(picture, |_, _, value| gain * value + 255.0 * offset)
}

/// Gaussian blur; `deviation` in pixels.
pub fn blurred(picture: &Picture, deviation: f32) -> Picture {
    let Picture { width, height, data } = picture;
    // Of 8-bit values the filter would cut off the fractions.
    let values = data.iter().map(|value| f32::from(*value)).collect();
    let image = Rgb32FImage::from_raw(*width, *height, values);
    let values = image.map(|image| gaussian_blur_f32(&image, deviation).into_raw());
    let data = values.unwrap_or_default().into_iter().map(|value| value.round() as u8).collect();
    Picture { width: *width, height: *height, data }
}

/// Marine snow: bright specks of 1 to 3 pixels.
pub fn snowy(picture: &Picture, seed: u64) -> Picture {
    let Picture { width, height, .. } = *picture;
    let (across, down) = (f64::from(width), f64::from(height));
    let mut drawn = even(seed).map(|v| 0.5 * (v + 1.0));
    let mut next = || drawn.next().unwrap_or_default();
    let mut snowy = picture.clone();
    for _ in 0..SPECKS {
        let (x, y, radius) = (next() * across, next() * down, 0.5 + next());
        let bright = (255.0 * (0.8 + 0.2 * next())).round() as u8;
        for row in (y - radius).max(0.0) as u32..=((y + radius) as u32).min(height - 1) {
            for column in (x - radius).max(0.0) as u32..=((x + radius) as u32).min(width - 1) {
                let away = (f64::from(column) + 0.5 - x).hypot(f64::from(row) + 0.5 - y);
                // The pixel in which it lies, however small it is.
                let own = column == x as u32 && row == y as u32;
                if own || away <= radius {
                    let at = (row as usize * width as usize + column as usize) * 3;
                    snowy.data[at..at + 3].fill(bright);
                }
            }
        }
    }
    snowy
}

/// Darker by `fall · r²`, `r` being 1 in the corners.
pub fn vignetted(picture: &Picture, fall: f64) -> Picture {
    let (x, y) = (0.5 * f64::from(picture.width), 0.5 * f64::from(picture.height));
    map(picture, |column, row, value| {
        let (dx, dy) = (column as f64 + 0.5 - x, row as f64 + 0.5 - y);
        value * (1.0 - fall * (dx * dx + dy * dy) / (x * x + y * y))
    })
}

/// Covers half of the picture with an upright block at a random place. The block shows a mirrored picture of the same
/// size.
pub fn covered(picture: &Picture, other: &Picture, seed: u64) -> Picture {
    let (width, height) = (picture.width as usize, picture.height as usize);
    let side = |length: usize| (length as f64 * 0.5f64.sqrt()).round() as usize;
    let mut drawn = even(seed).map(|v| 0.5 * (v + 1.0));
    let mut place = |length: usize| {
        (drawn.next().unwrap_or_default() * (length - side(length) + 1) as f64) as usize
    };
    let (left, top) = (place(width), place(height));
    let mut covered = picture.clone();
    for row in top..top + side(height) {
        for column in left..left + side(width) {
            let [to, from] = [column, width - 1 - column].map(|c| (row * width + c) * 3);
            covered.data[to..to + 3].copy_from_slice(&other.data[from..from + 3]);
        }
    }
    covered
}

/// A picture that shows nothing: a grey value in [0, 1], with independent normal noise of this deviation on every
/// value.
pub fn empty(camera: &Camera, grey: f64, deviation: f64, seed: u64) -> Picture {
    let mut picture = Picture::new(camera.width, camera.height);
    for (value, noise) in picture.data.iter_mut().zip(normal(seed)) {
        // Values beyond 0 and 255 are clamped.
        *value = (255.0 * (grey + deviation * noise)).round() as u8;
    }
    picture
}

/// The endless sequence of a seed, normal with mean 0 and deviation 1 (Box & Muller 1958).
fn normal(seed: u64) -> impl Iterator<Item = f64> {
    let mut even = even(seed);
    std::iter::repeat_with(move || {
        let mut next = || even.next().unwrap_or_default();
        // In (0, 1]: its logarithm is finite.
        let radius = (-2.0 * (0.5 * (1.0 - next())).ln()).sqrt();
        radius * (std::f64::consts::PI * next()).cos()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: Camera =
        Camera { width: 160, height: 90, fx: 100.0, fy: 100.0, cx: 80.0, cy: 45.0 };

    fn flat(value: u8) -> Picture {
        Picture::from_rgb(160, 90, vec![value; 160 * 90 * 3]).unwrap()
    }

    fn changed(a: &Picture, b: &Picture) -> f64 {
        let pairs = a.data.chunks_exact(3).zip(b.data.chunks_exact(3));
        pairs.filter(|(a, b)| a != b).count() as f64
    }

    #[test]
    fn light_is_scaled_and_raised() {
        assert_eq!(light(&flat(200), 0.25, 0.0), flat(50));
        assert_eq!(light(&flat(0), 0.2, 0.3).data[0], 77);
        assert_eq!(light(&flat(255), 0.2, 0.3).data[0], 128);
    }

    #[test]
    fn blur_spreads_a_point_as_a_gaussian_does() {
        let mut point = flat(0);
        point.data[(45 * 160 + 80) * 3] = 255;
        let blurred = blurred(&point, 2.0);
        let red = |column: usize| blurred.data[(45 * 160 + column) * 3];
        // 255 / (2π σ²).
        assert!(red(80).abs_diff(10) <= 1, "{}", red(80));
        assert!(red(82).abs_diff(6) <= 1 && red(90) == 0, "{}", red(82));
        assert_eq!(super::blurred(&flat(90), 2.0), flat(90));
    }

    #[test]
    fn snow_is_little_and_bright() {
        let snowy = super::snowy(&flat(50), 7);
        let count = changed(&snowy, &flat(50));
        // At most nine pixels a speck; some lie on others.
        assert!((50.0..=540.0).contains(&count), "{count}");
        assert!(snowy.data.iter().all(|v| *v == 50 || *v >= 204));
        assert_eq!(snowy, super::snowy(&flat(50), 7));
        assert_ne!(snowy, super::snowy(&flat(50), 8));
    }

    #[test]
    fn vignettes_leave_the_centre() {
        let dark = vignetted(&flat(200), 0.7);
        assert!(dark.data[0].abs_diff(61) <= 2, "{}", dark.data[0]);
        assert_eq!(dark.data[(45 * 160 + 80) * 3], 200);
    }

    #[test]
    fn half_is_covered_by_the_mirrored_picture() {
        let mut other = flat(90);
        other.data[..160 * 90 * 3].chunks_exact_mut(480).for_each(|row| row[..240].fill(10));
        for seed in 0..20 {
            let covered = covered(&flat(50), &other, seed);
            let share = changed(&covered, &flat(50)) / (160.0 * 90.0);
            assert!((0.48..0.52).contains(&share), "{share}");
            for (index, pixel) in covered.data.chunks_exact(3).enumerate() {
                assert!(pixel[0] == 50 || (pixel[0] == 10) == (index % 160 >= 80));
            }
        }
    }

    #[test]
    fn empty_pictures_are_grey_with_noise() {
        let silt = empty(&CAMERA, 0.45, 0.02, 3);
        let values = || silt.data.iter().map(|v| f64::from(*v) / 255.0);
        let count = silt.data.len() as f64;
        let mean = values().sum::<f64>() / count;
        let deviation = (values().map(|v| (v - mean).powi(2)).sum::<f64>() / count).sqrt();
        assert!(
            (mean - 0.45).abs() < 1e-3 && (deviation - 0.02).abs() < 1e-3,
            "{mean} {deviation}"
        );
        let black = empty(&CAMERA, 0.0, 1.0 / 255.0, 3);
        assert!(black.data.iter().all(|v| *v <= 6) && black.data.contains(&1));
    }
}
