//! Keypoints of pictures and matches between them: FAST corners on a pyramid, BRIEF descriptors turned
//! with the corner, as in ORB (Rublee, Rabaud, Konolige & Bradski, ICCV 2011).

use image::GrayImage;
use image::imageops::{FilterType, resize};
use imageproc::binary_descriptors::BinaryDescriptor;
use imageproc::binary_descriptors::brief::{BriefDescriptor, TestPair, brief};
use imageproc::corners::{Corner, corners_fast9};
use imageproc::point::Point;
use imageproc::suppress::local_maxima;

use super::super::perturbed::even;

/// Comparisons of a descriptor, bits.
const BITS: usize = 256;
/// Directions that descriptors are turned to.
const TURNS: usize = 30;
/// Comparisons stay within this distance of the corner, pixels: patches are 31 wide.
const REACH: f64 = 14.0;
/// Comparisons are spread around the corner with this standard deviation, pixels (ORB: a fifth of the patch).
const SPREAD: f64 = 6.2;
/// The direction of a corner is that of its patch's centroid within this distance, pixels.
const CENTROID: i32 = 15;
/// Least distance of corners from the edge, pixels: nearer to it, descriptors fail with an error.
const EDGE: u32 = 17;
/// Least contrast of corners, of 255. Pictures through water, and renders, are faint.
const CONTRAST: u8 = 4;
/// Of corners nearer to each other than this, pixels, only the best is kept.
const CROWD: u32 = 3;
/// Most corners of a level.
const CORNERS: usize = 400;
/// Reduction of each level of the pyramid against the one before.
const REDUCTION: f64 = 1.3;
const LEVELS: i32 = 5;
/// Bits in which the descriptors of a match may differ.
const DIFFERENCE: u32 = 72;
/// A match must be this much better than the second best (Lowe's ratio test).
const RATIO: f64 = 0.85;
/// A match nearer than this to the best one is the same thing, perhaps at another level, pixels.
const SAME: f64 = 6.0;

pub struct Feature {
    /// Pixels of the full picture; pixel centres lie at +0.5.
    pub at: [f64; 2],
    descriptor: BriefDescriptor,
}

/// What descriptors compare, for each direction.
pub struct Detector {
    pairs: Vec<Vec<TestPair>>,
}

impl Detector {
    pub fn new() -> Detector {
        let mut even = even(5);
        // The sum of three uniform values is nearly normal, with variance 1.
        let mut normal = || (0..3).filter_map(|_| even.next()).sum::<f64>() * SPREAD;
        let mut offset = || {
            loop {
                let at = [normal(), normal()];
                if at[0].hypot(at[1]) < REACH {
                    return at;
                }
            }
        };
        let upright: Vec<_> = (0..BITS).map(|_| [offset(), offset()]).collect();
        let turned = |turn: usize| {
            let angle = std::f64::consts::TAU * turn as f64 / TURNS as f64;
            let point = |[x, y]: [f64; 2]| {
                let (sine, cosine) = angle.sin_cos();
                // The crate counts from one before the patch's corner: 14 is its middle.
                let [x, y] = [cosine * x - sine * y, sine * x + cosine * y];
                Point::new((REACH + x).round() as u32, (REACH + y).round() as u32)
            };
            upright.iter().map(|[a, b]| TestPair { p0: point(*a), p1: point(*b) }).collect()
        };
        Detector { pairs: (0..TURNS).map(turned).collect() }
    }

    /// Keypoints of a picture, strongest first at each level.
    pub fn detect(&self, picture: &GrayImage) -> anyhow::Result<Vec<Feature>> {
        let (width, height) = picture.dimensions();
        let mut features = Vec::new();
        for level in 0..LEVELS {
            let reduced = |side: u32| (f64::from(side) / REDUCTION.powi(level)).round() as u32;
            let size = [reduced(width), reduced(height)];
            if size.iter().any(|side| *side <= 2 * EDGE + 1) {
                break;
            }
            let scale = [(width, size[0]), (height, size[1])]
                .map(|(full, side)| f64::from(full) / f64::from(side));
            let small = resize(picture, size[0], size[1], FilterType::Triangle);
            self.detect_level(&small, scale, &mut features)?;
        }
        Ok(features)
    }

    fn detect_level(
        &self,
        picture: &GrayImage,
        scale: [f64; 2],
        features: &mut Vec<Feature>,
    ) -> anyhow::Result<()> {
        let (width, height) = picture.dimensions();
        let inside = |c: &Corner| {
            (EDGE..width - EDGE).contains(&c.x) && (EDGE..height - EDGE).contains(&c.y)
        };
        let mut corners = local_maxima(&corners_fast9(picture, CONTRAST), CROWD);
        corners.retain(inside);
        corners.sort_by(|a, b| b.score.total_cmp(&a.score).then((a.y, a.x).cmp(&(b.y, b.x))));
        corners.truncate(CORNERS);
        let mut by_turn = vec![Vec::new(); TURNS];
        for corner in corners {
            by_turn[turn(picture, &corner)].push(Point::new(corner.x, corner.y));
        }
        for (points, pairs) in by_turn.iter().zip(&self.pairs).filter(|(p, _)| !p.is_empty()) {
            let described =
                brief(picture, points, BITS, Some(pairs)).map_err(anyhow::Error::msg)?;
            features.extend(described.0.into_iter().map(|descriptor| {
                let Point { x, y } = descriptor.position();
                let at = [(f64::from(x) + 0.5) * scale[0], (f64::from(y) + 0.5) * scale[1]];
                Feature { at, descriptor }
            }));
        }
        Ok(())
    }
}

/// Which of the directions a corner has.
fn turn(picture: &GrayImage, corner: &Corner) -> usize {
    let (mut x, mut y) = (0.0, 0.0);
    for dy in -CENTROID..=CENTROID {
        for dx in -CENTROID..=CENTROID {
            if dx * dx + dy * dy <= CENTROID * CENTROID {
                let at = |centre: u32, offset: i32| centre.saturating_add_signed(offset);
                let value = f64::from(picture.get_pixel(at(corner.x, dx), at(corner.y, dy)).0[0]);
                (x, y) = (x + value * f64::from(dx), y + value * f64::from(dy));
            }
        }
    }
    let share = f64::atan2(y, x).rem_euclid(std::f64::consts::TAU) / std::f64::consts::TAU;
    (share * TURNS as f64).round() as usize % TURNS
}

/// The best matches of two pictures' keypoints, at most `max`, best first. The two are each other's best, clearly
/// better than the second best, and no two matches are at the same place.
pub fn matches(a: &[Feature], b: &[Feature], max: usize) -> Vec<(usize, usize)> {
    let back: Vec<_> = b.iter().map(|feature| best(feature, a)).collect();
    let mut found: Vec<(u32, usize, usize)> = Vec::new();
    for (i, feature) in a.iter().enumerate() {
        let Some((j, difference)) = best(feature, b) else { continue };
        let mutual = back[j].is_some_and(|(k, _)| k == i || distance(&a[k], feature) < SAME);
        if mutual {
            found.push((difference, i, j));
        }
    }
    found.sort_unstable();
    let mut kept: Vec<(usize, usize)> = Vec::new();
    for (_, i, j) in found {
        if kept.len() < max && kept.iter().all(|(k, _)| distance(&a[*k], &a[i]) >= SAME) {
            kept.push((i, j));
        }
    }
    kept
}

/// The match of a keypoint among others, and the bits that differ.
fn best(feature: &Feature, among: &[Feature]) -> Option<(usize, u32)> {
    let difference = |other: &Feature| feature.descriptor.hamming_distance(&other.descriptor);
    let differences: Vec<u32> = among.iter().map(difference).collect();
    let (first, min) = differences.iter().copied().enumerate().min_by_key(|(_, d)| *d)?;
    let elsewhere = |(i, _): &(usize, &u32)| distance(&among[*i], &among[first]) >= SAME;
    let second = differences.iter().enumerate().filter(elsewhere).map(|(_, d)| *d).min();
    let clear = second.is_none_or(|second| f64::from(min) < RATIO * f64::from(second));
    (min <= DIFFERENCE && clear).then_some((first, min))
}

fn distance(a: &Feature, b: &Feature) -> f64 {
    f64::hypot(a.at[0] - b.at[0], a.at[1] - b.at[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Blots of many sizes about the middle, turned by an angle.
    fn blots(angle: f64) -> GrayImage {
        let mut even = even(9);
        let mut next = || even.next().unwrap();
        let (sine, cosine) = angle.sin_cos();
        let blots: Vec<[f64; 4]> = (0..150)
            .map(|_| {
                let (x, y) = (120.0 * next(), 80.0 * next());
                let (x, y) = (cosine * x - sine * y + 160.0, sine * x + cosine * y + 90.0);
                [x, y, 3.0 + 2.0 * next(), 60.0 * next()]
            })
            .collect();
        GrayImage::from_fn(320, 180, |x, y| {
            let at = |[bx, by, size, height]: &[f64; 4]| {
                let square = (f64::from(x) - bx).powi(2) + (f64::from(y) - by).powi(2);
                height * (-0.5 * square / (size * size)).exp()
            };
            image::Luma([(128.0 + blots.iter().map(at).sum::<f64>()).clamp(0.0, 255.0) as u8])
        })
    }

    #[test]
    fn matches_of_a_turned_picture_are_nearly_all_right() {
        let detector = Detector::new();
        let before = detector.detect(&blots(0.0)).unwrap();
        for angle in [0.0f64, 0.35, -0.7] {
            let after = detector.detect(&blots(angle)).unwrap();
            let found = matches(&before, &after, 20);
            let (sine, cosine) = angle.sin_cos();
            let right = found.iter().filter(|(i, j)| {
                let [x, y] = [before[*i].at[0] - 160.5, before[*i].at[1] - 90.5];
                let expected = [cosine * x - sine * y + 160.5, sine * x + cosine * y + 90.5];
                let at = after[*j].at;
                f64::hypot(at[0] - expected[0], at[1] - expected[1]) < 3.0
            });
            let right = right.count();
            assert!(found.len() >= 15 && right * 10 >= found.len() * 8, "{right}/{}", found.len());
        }
    }

    #[test]
    fn flat_and_tiny_pictures_have_no_keypoints() {
        let detector = Detector::new();
        for (width, height) in [(320, 180), (35, 35), (1, 1)] {
            let flat = GrayImage::from_pixel(width, height, image::Luma([90]));
            assert!(detector.detect(&flat).unwrap().is_empty());
        }
        assert!(matches(&[], &[], 20).is_empty());
    }
}
