//! Pictures without noise and detail, for comparing.

use crate::Picture;

/// How far a blurred pixel reaches, pixels.
const REACH: usize = 2;

/// Means over squares of 5 × 5 pixels, RGB, row by row; fewer at the picture's edges.
pub fn blurred(picture: &Picture) -> Vec<[f32; 3]> {
    let (width, height) = (picture.width as usize, picture.height as usize);
    let (pixels, _) = picture.data.as_chunks::<3>();
    let rows: Vec<[f32; 3]> = (0..width * height)
        .map(|at| {
            let (x, row) = (at % width, at / width * width);
            let near = row + x.saturating_sub(REACH)..row + (x + REACH + 1).min(width);
            sum(pixels[near].iter().map(|pixel| pixel.map(f32::from)))
        })
        .collect();
    (0..width * height)
        .map(|at| {
            let (x, y) = (at % width, at / width);
            let near = y.saturating_sub(REACH)..(y + REACH + 1).min(height);
            let across = (x + REACH + 1).min(width) - x.saturating_sub(REACH);
            let share = 1.0 / (near.len() * across) as f32;
            sum(near.map(|y| rows[y * width + x])).map(|v| v * share)
        })
        .collect()
}

fn sum(pixels: impl Iterator<Item = [f32; 3]>) -> [f32; 3] {
    pixels.fold([0.0; 3], |[r, g, b], [x, y, z]| [r + x, g + y, b + z])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_are_over_what_is_there() {
        let mut picture = Picture::new(7, 6);
        picture.data.iter_mut().enumerate().for_each(|(i, v)| *v = (i * 37 % 251) as u8);
        let found = blurred(&picture);
        for (y, x) in [(0_i32, 0_i32), (3, 3), (5, 6), (1, 5)] {
            let mut sum = [0.0_f32; 3];
            let mut count = 0.0;
            for (v, u) in (y - 2..=y + 2).flat_map(|v| (x - 2..=x + 2).map(move |u| (v, u))) {
                if (0..6).contains(&v) && (0..7).contains(&u) {
                    let at = 3 * (v * 7 + u) as usize;
                    (0..3).for_each(|c| sum[c] += f32::from(picture.data[at + c]));
                    count += 1.0;
                }
            }
            for c in 0..3 {
                assert!((found[(y * 7 + x) as usize][c] - sum[c] / count).abs() < 1e-3);
            }
        }
    }
}
