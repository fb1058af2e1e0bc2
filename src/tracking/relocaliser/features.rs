//! Corners of a picture at several sizes (Shi & Tomasi, CVPR 1994), with their descriptors. Local contrast is made even
//! first.

use super::descriptor::{Describer, Descriptor, RADIUS};

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Feature {
    /// Pixels of the picture; pixel (0, 0) covers [0, 1) × [0, 1).
    pub place: [f32; 2],
    /// See [`Descriptor`].
    pub descriptor: Descriptor,
}

/// Levels of the picture's pyramid, the first one at [`FINEST`] times its size.
const LEVELS: usize = 8;
/// Sizes of levels that follow each other.
const RATIO: f32 = 1.2;
/// Pictures are enlarged by this, as they are small: a patch of the finest level then covers 15 pixels.
const FINEST: f32 = 2.0;
/// No level is wider than this, pixels.
const WIDEST: f32 = 640.0;
/// Half the side of the window over which contrast is made even, pixels of the picture.
const EVEN: usize = 12;
/// Noise that contrast is measured against, values in [0, 1].
const NOISE: f32 = 1.0 / 255.0;

/// A corner of a level, before it has a descriptor.
#[derive(Clone, Copy)]
struct Corner {
    strength: f32,
    at: u32,
}

struct Level {
    scale: f32,
    width: usize,
    height: usize,
    /// Most corners of the level.
    max: usize,
}

/// Takes features of pictures of one size. Allocates nothing after it is made.
pub struct Extractor {
    width: usize,
    height: usize,
    levels: Vec<Level>,
    even: Vec<f32>,
    spread: Vec<f32>,
    level: Vec<f32>,
    smooth: Vec<f32>,
    products: [Vec<f32>; 3],
    sums: Vec<f32>,
    strengths: Vec<f32>,
    corners: Vec<Corner>,
    describer: Describer,
}

impl Extractor {
    /// For pictures of `width` × `height`, and about `max` features.
    pub fn new(width: usize, height: usize, max: usize) -> Extractor {
        let finest = FINEST.min(WIDEST / width.max(1) as f32);
        let all: f32 = (0..LEVELS).map(|k| RATIO.powi(-(k as i32))).sum();
        let level = |k: usize| {
            let share = RATIO.powi(-(k as i32));
            let scale = finest * share;
            let size = |n: usize| (n as f32 * scale).round() as usize;
            let max = (max as f32 * share / all).round() as usize;
            Level { scale, width: size(width), height: size(height), max }
        };
        let wide_enough = |l: &Level| l.width > 2 * RADIUS + 2 && l.height > 2 * RADIUS + 2;
        let levels: Vec<Level> = (0..LEVELS).map(level).filter(wide_enough).collect();
        let largest = levels.iter().map(|l| l.width * l.height).max().unwrap_or(0);
        let room = largest.max(width * height);
        let zeros = || vec![0.0; room];
        Extractor {
            width,
            height,
            levels,
            even: vec![0.0; width * height],
            spread: zeros(),
            level: zeros(),
            smooth: zeros(),
            products: [zeros(), zeros(), zeros()],
            sums: zeros(),
            strengths: zeros(),
            // Of eight neighbours one at most is a corner.
            corners: Vec::with_capacity(room / 2 + 1),
            describer: Describer::new(room),
        }
    }

    /// Takes the features of a picture's luma: values in [0, 1], row by row. The strongest come first at each level.
    ///
    /// # Panics
    /// If the number of pixels is not that of the size.
    pub fn extract(&mut self, luma: &[f32], features: &mut Vec<Feature>) {
        assert_eq!(luma.len(), self.width * self.height, "pixels");
        features.clear();
        self.make_even(luma);
        for k in 0..self.levels.len() {
            self.resize(k);
            self.find_corners(k);
            self.describe(k, features);
        }
    }

    /// Removes the local mean and divides by the local deviation.
    fn make_even(&mut self, luma: &[f32]) {
        let (width, height, count) = (self.width, self.height, luma.len());
        let finite = |v: f32| if v.is_finite() { v } else { 0.0 };
        self.level[..count].iter_mut().zip(luma).for_each(|(to, v)| *to = finite(*v));
        box_mean(&self.level[..count], &mut self.sums, &mut self.spread, width, height, EVEN);
        for (i, to) in self.even.iter_mut().enumerate() {
            *to = self.level[i] - self.spread[i];
            self.smooth[i] = *to * *to;
        }
        box_mean(&self.smooth[..count], &mut self.sums, &mut self.spread, width, height, EVEN);
        for (to, square) in self.even.iter_mut().zip(&self.spread) {
            *to /= square.max(0.0).sqrt() + NOISE;
        }
    }

    /// Brings the picture to a level's size by interpolation, and makes a smoothed copy for descriptors.
    fn resize(&mut self, k: usize) {
        let Level { scale, width, height, .. } = self.levels[k];
        let (from_width, from_height) = (self.width, self.height);
        for y in 0..height {
            let v = ((y as f32 + 0.5) / scale - 0.5).clamp(0.0, (from_height - 1) as f32);
            let row = v as usize;
            let ay = v - row as f32;
            let upper = &self.even[row * from_width..][..from_width];
            let lower = &self.even[(row + 1).min(from_height - 1) * from_width..][..from_width];
            for (x, to) in self.level[y * width..][..width].iter_mut().enumerate() {
                let u = ((x as f32 + 0.5) / scale - 0.5).clamp(0.0, (from_width - 1) as f32);
                let left = u as usize;
                let ax = u - left as f32;
                let right = (left + 1).min(from_width - 1);
                let above = upper[left] + (upper[right] - upper[left]) * ax;
                let below = lower[left] + (lower[right] - lower[left]) * ax;
                *to = above + (below - above) * ay;
            }
        }
        let count = width * height;
        box_mean(&self.level[..count], &mut self.sums, &mut self.spread, width, height, 1);
        box_mean(&self.spread[..count], &mut self.sums, &mut self.smooth, width, height, 2);
    }

    /// Finds the strongest corners of a level: maxima, within two pixels, of the least eigenvalue of the gradient's
    /// second moments.
    fn find_corners(&mut self, k: usize) {
        let Level { width, height, max, .. } = self.levels[k];
        let count = width * height;
        let [xx, xy, yy] = &mut self.products;
        for p in [&mut *xx, &mut *xy, &mut *yy] {
            p[..count].fill(0.0);
        }
        for i in width..count - width {
            if i % width == 0 || i % width == width - 1 {
                continue;
            }
            let dx = self.level[i + 1] - self.level[i - 1];
            let dy = self.level[i + width] - self.level[i - width];
            (xx[i], xy[i], yy[i]) = (dx * dx, dx * dy, dy * dy);
        }
        for p in &mut self.products {
            box_mean(&p[..count], &mut self.sums, &mut self.spread, width, height, 2);
            p[..count].copy_from_slice(&self.spread[..count]);
        }
        for i in 0..count {
            let (a, b, c) = (self.products[0][i], self.products[1][i], self.products[2][i]);
            let half = 0.5 * (a - c);
            self.strengths[i] = 0.5 * (a + c) - (half * half + b * b).sqrt();
        }
        self.corners.clear();
        for y in RADIUS + 1..height - RADIUS - 1 {
            for x in RADIUS + 1..width - RADIUS - 1 {
                let strength = self.strengths[y * width + x];
                if strength > 1e-4 && highest(&self.strengths, width, x, y, strength) {
                    self.corners.push(Corner { strength, at: (y * width + x) as u32 });
                }
            }
        }
        let order =
            |a: &Corner, b: &Corner| b.strength.total_cmp(&a.strength).then(a.at.cmp(&b.at));
        if self.corners.len() > max && max > 0 {
            self.corners.select_nth_unstable_by(max - 1, order);
        }
        self.corners.truncate(max);
        self.corners.sort_unstable_by(order);
    }

    /// Adds the level's corners with their descriptors.
    fn describe(&mut self, k: usize, features: &mut Vec<Feature>) {
        let Level { scale, width, height, .. } = self.levels[k];
        self.describer.set(&self.smooth[..width * height], width);
        for corner in &self.corners {
            let at = corner.at as usize;
            let (x, y) = ((at % width) as f32 + 0.5, (at / width) as f32 + 0.5);
            let descriptor = self.describer.describe(at);
            features.push(Feature { place: [x / scale, y / scale], descriptor });
        }
    }
}

/// Whether a value is the highest within two pixels. Of equal values the first one counts.
fn highest(values: &[f32], width: usize, x: usize, y: usize, value: f32) -> bool {
    let row = |v: usize| &values[v * width + x - 2..][..5];
    let own = row(y);
    // Most pixels are out at once.
    if own[1] >= value || own[3] > value || own[0] >= value || own[4] > value {
        return false;
    }
    let below = |v: usize| row(v).iter().all(|other| *other < value);
    let not_above = |v: usize| row(v).iter().all(|other| *other <= value);
    below(y - 1) && below(y - 2) && not_above(y + 1) && not_above(y + 2)
}

/// Mean over a square of side `2 radius + 1`, cut off at the picture's edges.
fn box_mean(
    from: &[f32],
    rows: &mut [f32],
    to: &mut [f32],
    width: usize,
    height: usize,
    radius: usize,
) {
    for (from, to) in from.chunks_exact(width).zip(rows.chunks_exact_mut(width)) {
        along(from, to, radius);
    }
    for (y, to) in to.chunks_exact_mut(width).take(height).enumerate() {
        let first = y.saturating_sub(radius);
        let last = (y + radius).min(height - 1);
        let scale = 1.0 / (last - first + 1) as f32;
        to.fill(0.0);
        for row in rows.chunks_exact(width).take(last + 1).skip(first) {
            to.iter_mut().zip(row).for_each(|(to, row)| *to += row);
        }
        to.iter_mut().for_each(|to| *to *= scale);
    }
}

/// Means along a row, cut off at its ends. Short sums are taken for many pixels at once; a long sum is updated from
/// pixel to pixel.
fn along(from: &[f32], to: &mut [f32], radius: usize) {
    let width = from.len();
    let side = 2 * radius + 1;
    let cut = |x: usize| &from[x.saturating_sub(radius)..(x + radius + 1).min(width)];
    let mean = |part: &[f32]| part.iter().sum::<f32>() / part.len() as f32;
    if width < side {
        to.iter_mut().enumerate().for_each(|(x, to)| *to = mean(cut(x)));
        return;
    }
    for x in (0..radius).chain(width - radius..width) {
        to[x] = mean(cut(x));
    }
    let (middle, scale) = (&mut to[radius..width - radius], 1.0 / side as f32);
    if radius > 3 {
        let mut sum: f32 = from[..side].iter().sum();
        for (x, to) in middle.iter_mut().enumerate() {
            *to = sum * scale;
            sum += from.get(x + side).unwrap_or(&0.0) - from[x];
        }
        return;
    }
    middle.fill(0.0);
    for offset in 0..side {
        middle.iter_mut().zip(&from[offset..]).for_each(|(to, from)| *to += from);
    }
    middle.iter_mut().for_each(|to| *to *= scale);
}

#[cfg(test)]
mod tests {
    use super::super::descriptor::distance;
    use super::*;

    /// Dots of several sizes and brightness, from a place in an endless plane.
    fn plane(x: f32, y: f32) -> f32 {
        let cell = |size: f32, seed: u32| {
            let (i, j) = ((x / size).floor(), (y / size).floor());
            let mut z = (i as i32 as u32).wrapping_mul(0x9e37_79b9)
                ^ (j as i32 as u32).wrapping_mul(0x85eb_ca6b)
                ^ seed;
            z = (z ^ (z >> 15)).wrapping_mul(0xc2b2_ae35);
            f32::from((z ^ (z >> 13)) as u8) / 255.0
        };
        0.25 + 0.25 * cell(23.0, 1) + 0.25 * cell(11.0, 2) + 0.15 * cell(7.0, 3)
    }

    /// A picture of 200 × 120 of the plane, rolled about its middle and moved.
    fn view(roll: f32, dx: f32) -> Vec<f32> {
        let (s, c) = roll.sin_cos();
        let at = |i: usize| {
            let (x, y) = ((i % 200) as f32 - 99.5, (i / 200) as f32 - 59.5);
            plane(c * x - s * y + dx, s * x + c * y)
        };
        (0..200 * 120).map(at).collect()
    }

    /// How many features of one picture match one of the other, and how many of those matches are right.
    fn matched(a: &[Feature], b: &[Feature], roll: f32, dx: f32) -> (usize, usize) {
        let (s, c) = roll.sin_cos();
        let (mut all, mut right) = (0, 0);
        for feature in a {
            let mut best: Vec<(u32, &Feature)> =
                b.iter().map(|f| (distance(&feature.descriptor, &f.descriptor), f)).collect();
            best.sort_by_key(|(d, _)| *d);
            if f64::from(best[0].0) < 0.8 * f64::from(best[1].0) {
                all += 1;
                let [x, y] = best[0].1.place;
                let (x, y) = (x - 100.0, y - 60.0);
                let there = [c * x - s * y + dx + 100.0, s * x + c * y + 60.0];
                let off = (there[0] - feature.place[0]).hypot(there[1] - feature.place[1]);
                right += usize::from(off < 3.0);
            }
        }
        (all, right)
    }

    #[test]
    fn features_hold_for_roll_gain_and_offset() {
        let mut extractor = Extractor::new(200, 120, 400);
        let (mut a, mut b) = (Vec::new(), Vec::new());
        extractor.extract(&view(0.0, 0.0), &mut a);
        assert!(a.len() > 150, "{}", a.len());
        for (roll, dx, gain, offset) in [
            (0.0, 10.0, 1.0, 0.0),
            (0.6, 5.0, 1.0, 0.0),
            (-2.0, 0.0, 0.25, 0.0),
            (3.1, -8.0, 0.2, 0.3),
        ] {
            let eight_bits = |v: f32| ((v * gain + offset) * 255.0).round() / 255.0;
            let picture: Vec<f32> = view(roll, dx).into_iter().map(eight_bits).collect();
            extractor.extract(&picture, &mut b);
            let (all, right) = matched(&a, &b, roll, dx);
            assert!(right > 40 && right * 10 > all * 8, "{roll} {gain}: {right} of {all}");
        }
    }

    #[test]
    fn flat_small_and_broken_pictures_have_none() {
        for (width, height) in [(200, 120), (1, 1), (33, 2), (40, 40)] {
            for value in [0.0, 0.7, f32::NAN, f32::INFINITY] {
                let mut features = Vec::new();
                let mut extractor = Extractor::new(width, height, 100);
                extractor.extract(&vec![value; width * height], &mut features);
                assert!(features.is_empty(), "{width}×{height} {value}");
            }
        }
    }

    #[test]
    fn a_second_picture_takes_no_room() {
        let mut extractor = Extractor::new(200, 120, 400);
        let mut features = Vec::with_capacity(500);
        extractor.extract(&view(0.0, 0.0), &mut features);
        let before = (extractor.corners.capacity(), features.capacity());
        extractor.extract(&view(0.4, 3.0), &mut features);
        assert_eq!(before, (extractor.corners.capacity(), features.capacity()));
    }
}
