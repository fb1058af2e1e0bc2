//! Resection: the pose that explains most matches of world points with points of a picture. RANSAC (Fischler & Bolles
//! 1981) over [`super::p3p`], then Gauss–Newton on the distances in the picture.

use glam::DVec3;

use super::p3p;
use crate::random::Random;
use crate::search::damped_step;
use crate::shared::SUMS;
use crate::{Camera, Pose};

/// Draws of three points. Fewer are taken once another draw would hardly give a better pose.
const DRAWS: usize = 2000;
/// The chance that the draws, if they end early, held no three right points.
const MISSED: f64 = 1e-3;
/// With no more matches than this, each pose is compared by all matches at once. With more, a pose must first explain a
/// fourth point. If few matches are right, a right fourth one is seldom drawn.
const FEW: usize = 100;
/// Cosine of the largest angle between two directions from which a corner still looks the same.
pub const TURNED: f64 = 0.6;
/// A point counts as seen within this many pixels while poses are compared.
const WITHIN: f64 = 3.0;
/// One step of Gauss–Newton each: the distance, in pixels, at which Geman & McClure's weight of a
/// point is a half. The weights become narrower.
const WIDTHS: [f64; 8] = [6.0, 4.0, 3.0, 2.0, 2.0, 1.5, 1.5, 1.5];
/// Damping of Gauss–Newton, relative to the diagonal.
const DAMPING: f32 = 1e-4;

/// A place of the picture, and the world point that may be seen there.
#[derive(Clone, Copy, Debug)]
pub struct Match {
    /// Index of the picture's feature: several points may be proposed for one.
    pub feature: u32,
    /// Pixels.
    pub place: [f32; 2],
    /// World axes.
    pub point: DVec3,
}

/// A pose, and how many of the picture's features it explains.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Resected {
    /// World-to-camera.
    pub pose: Pose,
    /// Features seen within three pixels.
    pub features: u32,
}

/// Where a camera may stand: from far away corners look different.
#[derive(Clone, Copy, Debug)]
pub struct Around {
    /// World axes.
    pub centre: DVec3,
    /// Farthest from the centre.
    pub reach: f64,
    /// Where the camera looks, within [`TURNED`] of it, world axes.
    pub axis: DVec3,
}

impl Around {
    /// Whether a pose is such a one.
    pub fn holds(&self, pose: &Pose) -> bool {
        (pose.centre() - self.centre).length() < self.reach && axis(pose).dot(self.axis) > TURNED
    }
}

/// Where a camera looks, world axes.
pub fn axis(pose: &Pose) -> DVec3 {
    pose.rotation.conjugate() * DVec3::Z
}

/// Buffers for resection. Allocates nothing if a picture has no more features than they were made for.
pub struct Resection {
    camera: Camera,
    /// The call in which a feature was last counted.
    counted: Vec<u32>,
    calls: u32,
}

impl Resection {
    /// Makes one for pictures of a camera with at most `features` features.
    pub fn new(camera: &Camera, features: usize) -> Resection {
        Resection { camera: *camera, counted: vec![0; features], calls: 0 }
    }

    /// The best pose of `matches`; tries `guess` too, if there is one. `None` for fewer than four matches, or if no
    /// pose lies where the camera may stand. Matches of one feature must be next to each other. The same input gives
    /// the same pose.
    pub fn resect(
        &mut self,
        matches: &[Match],
        guess: Option<Pose>,
        around: Option<&Around>,
    ) -> Option<Resected> {
        if matches.len() < 4 {
            return None;
        }
        let mut best: Option<Resected> = None;
        if let Some(pose) = guess {
            self.take(&mut best, matches, pose);
        }
        self.draw(&mut best, matches, around);
        let best = best?;
        let pose = self.refined(matches, best.pose);
        let features = self.count(matches, &pose);
        // By chance a pose from three points may explain a few more points than the best pose of all.
        let as_good = features * 10 >= best.features * 9;
        Some(if as_good { Resected { pose, features } } else { best })
    }

    /// Draws matches, and takes the poses of three of them.
    fn draw(&mut self, best: &mut Option<Resected>, matches: &[Match], around: Option<&Around>) {
        let few = matches.len() <= FEW;
        let needed = if few { 3 } else { 4 };
        let mut random = Random::new(matches.len() as u64);
        let mut draws = DRAWS;
        let mut drawn = 0;
        while drawn < draws {
            drawn += 1;
            let chosen = [0; 4].map(|_| &matches[below(&mut random, matches.len())]);
            let differs = |i: usize| (0..i).all(|j| chosen[i].feature != chosen[j].feature);
            if !(0..needed).all(differs) {
                continue;
            }
            let rays = [0, 1, 2].map(|i| self.ray(chosen[i]));
            let points = [0, 1, 2].map(|i| chosen[i].point);
            for pose in p3p::poses(rays, points).into_iter().flatten() {
                let worth = around.is_none_or(|around| around.holds(&pose))
                    && (few || self.off(&pose, chosen[3]) < 4.0 * WITHIN);
                if worth && self.take(best, matches, pose) {
                    let features = best.map_or(0, |best| best.features);
                    draws = draws.min(enough(features, matches, needed as i32));
                }
            }
        }
    }

    /// Takes a pose if it explains more features than the best one.
    fn take(&mut self, best: &mut Option<Resected>, matches: &[Match], pose: Pose) -> bool {
        let features = self.count(matches, &pose);
        let better = best.is_none_or(|best| features > best.features);
        if better {
            *best = Some(Resected { pose, features });
        }
        better
    }

    /// Features that are seen within [`WITHIN`].
    pub fn count(&mut self, matches: &[Match], pose: &Pose) -> u32 {
        self.calls = self.calls.wrapping_add(1);
        let mut count = 0;
        for of in matches {
            let seen = |([x, y], _): ([f64; 2], DVec3)| x * x + y * y < WITHIN * WITHIN;
            if self.residual(pose, of).is_some_and(seen) {
                let counted = &mut self.counted[of.feature as usize];
                count += u32::from(*counted != self.calls);
                *counted = self.calls;
            }
        }
        count
    }

    fn ray(&self, of: &Match) -> DVec3 {
        let Camera { fx, fy, cx, cy, .. } = self.camera;
        DVec3::new(((of.place[0] - cx) / fx).into(), ((of.place[1] - cy) / fy).into(), 1.0)
    }

    /// The place at which a pose sees a point, less its place in the picture, pixels; and the point in camera axes.
    /// `None` for points behind the camera.
    fn residual(&self, pose: &Pose, of: &Match) -> Option<([f64; 2], DVec3)> {
        let Camera { fx, fy, cx, cy, .. } = self.camera;
        let p = pose.rotation * of.point + pose.translation;
        if !(p.z > 1e-9) {
            return None;
        }
        let x = f64::from(fx) * p.x / p.z + f64::from(cx) - f64::from(of.place[0]);
        let y = f64::from(fy) * p.y / p.z + f64::from(cy) - f64::from(of.place[1]);
        Some(([x, y], p))
    }

    /// Distance of the two, pixels.
    fn off(&self, pose: &Pose, of: &Match) -> f64 {
        self.residual(pose, of).map_or(f64::INFINITY, |([x, y], _)| x.hypot(y))
    }

    /// A few steps of robust Gauss–Newton.
    fn refined(&self, matches: &[Match], mut pose: Pose) -> Pose {
        for width in WIDTHS {
            let mut sums = [0.0_f64; SUMS as usize];
            for of in matches {
                if let Some((residual, p)) = self.residual(&pose, of) {
                    self.add(&mut sums, residual, p, width);
                }
            }
            let step = damped_step(&sums.map(|v| v as f32), DAMPING);
            if !step.downhill {
                break;
            }
            pose = pose.stepped(&step.tau.map(f64::from));
        }
        pose
    }

    /// Adds a point to the normal equations of a left step.
    fn add(&self, sums: &mut [f64; SUMS as usize], residual: [f64; 2], p: DVec3, width: f64) {
        let square = residual[0] * residual[0] + residual[1] * residual[1];
        let weight = (1.0 / (1.0 + square / (width * width))).powi(2);
        let (fx, fy) = (f64::from(self.camera.fx) / p.z, f64::from(self.camera.fy) / p.z);
        let (x, y) = (p.x / p.z, p.y / p.z);
        // dp = ρ + θ × p.
        let rows = [
            [fx, 0.0, -fx * x, -fx * x * p.y, fx * (p.z + x * p.x), -fx * p.y],
            [0.0, fy, -fy * y, -fy * (p.z + y * p.y), fy * y * p.x, fy * p.x],
        ];
        for (row, r) in rows.iter().zip(residual) {
            let mut at = 0;
            for i in 0..6 {
                for j in i..6 {
                    sums[at] += weight * row[i] * row[j];
                    at += 1;
                }
                sums[21 + i] += weight * row[i] * r;
            }
            sums[27] += weight * r * r;
        }
    }
}

/// How many draws are enough if the best explains `features` features and a draw needs `needed` right matches.
fn enough(features: u32, matches: &[Match], needed: i32) -> usize {
    let right = f64::from(features) / matches.len() as f64;
    let draws = MISSED.ln() / (1.0 - right.min(0.99).powi(needed)).ln();
    if draws.is_finite() { draws.max(20.0) as usize } else { usize::MAX }
}

/// One of `end` numbers from 0 on.
fn below(random: &mut Random, end: usize) -> usize {
    ((random.bits() >> 32) as usize * end) >> 32
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: Camera =
        Camera { width: 320, height: 180, fx: 230.0, fy: 230.0, cx: 160.0, cy: 90.0 };

    /// `right` matches of a pose with half a pixel of noise, and `wrong` ones.
    fn matches(truth: &Pose, right: usize, wrong: usize) -> Vec<Match> {
        let mut random = Random::new(99);
        let mut even = move || below(&mut random, 1 << 20) as f64 / f64::from(1 << 20);
        let mut all = Vec::new();
        for feature in 0..(right + wrong) as u32 {
            let place = [(320.0 * even()) as f32, (180.0 * even()) as f32];
            let z = 2.0 + 4.0 * even();
            let noise = [even() - 0.5, even() - 0.5];
            let seen = if (feature as usize) < right {
                [f64::from(place[0]) + noise[0], f64::from(place[1]) + noise[1]]
            } else {
                [320.0 * even(), 180.0 * even()]
            };
            let p = DVec3::new((seen[0] - 160.0) / 230.0 * z, (seen[1] - 90.0) / 230.0 * z, z);
            let back = truth.inverse();
            all.push(Match { feature, place, point: back.rotation * p + back.translation });
        }
        all
    }

    #[test]
    fn a_fifth_of_right_matches_is_enough() {
        let truth = Pose::exp(&[0.5, -1.0, 2.0, 0.3, -2.0, 1.0]);
        for (right, wrong) in [(300, 0), (100, 100), (60, 240)] {
            let matches = matches(&truth, right, wrong);
            let mut resection = Resection::new(&CAMERA, matches.len());
            let found = resection.resect(&matches, None, None).unwrap();
            assert!(found.features as usize + 2 >= right, "{} of {right}", found.features);
            // A pixel is 4e-3 radians, and 0.02 at the middle of the points.
            let off = (found.pose.centre() - truth.centre()).length();
            let turned = found.pose.angle_to(&truth);
            assert!(turned < 8e-3 && off < 0.04, "{right} of {wrong} wrong: {turned} {off}");
            assert_eq!(resection.resect(&matches, None, None), Some(found));
        }
    }

    #[test]
    fn few_right_matches_among_few_are_found() {
        let truth = Pose::exp(&[0.5, -1.0, 2.0, 0.3, -2.0, 1.0]);
        for wrong in 32..42 {
            let matches = matches(&truth, 8, wrong);
            let found =
                Resection::new(&CAMERA, matches.len()).resect(&matches, None, None).unwrap();
            let off = (found.pose.centre() - truth.centre()).length();
            assert!(found.features >= 8 && off < 0.2, "{wrong} wrong: {found:?}, {off}");
        }
    }

    #[test]
    fn only_poses_where_the_camera_may_stand_count() {
        let truth = Pose::exp(&[0.5, -1.0, 2.0, 0.3, -2.0, 1.0]);
        let matches = matches(&truth, 100, 20);
        let mut resection = Resection::new(&CAMERA, matches.len());
        let here = Around { centre: truth.centre(), reach: 1.0, axis: axis(&truth) };
        let found = resection.resect(&matches, None, Some(&here)).unwrap();
        assert!(found.features >= 98, "{found:?}");
        let away = Around { centre: truth.centre() + 3.0 * DVec3::X, ..here };
        let behind = Around { axis: -here.axis, ..here };
        for elsewhere in [away, behind] {
            let found = resection.resect(&matches, None, Some(&elsewhere));
            assert!(found.is_none_or(|found| found.features < 20), "{found:?}");
        }
    }

    #[test]
    fn nothing_is_found_among_wrong_ones() {
        let matches = matches(&Pose::IDENTITY, 0, 300);
        let found = Resection::new(&CAMERA, 300).resect(&matches, None, None);
        assert!(found.is_none_or(|found| found.features < 20), "{found:?}");
        assert!(Resection::new(&CAMERA, 300).resect(&matches[..3], None, None).is_none());
    }

    #[test]
    fn origins_can_be_moved() {
        let pose = Pose::exp(&[0.5, -1.0, 2.0, 0.3, -2.0, 1.0]);
        let origin = DVec3::new(100.0, -5.0, 2.0);
        let there = pose.relative_to(origin);
        let point = DVec3::new(1.0, 2.0, 3.0);
        let (a, b) = (pose.rotation * point + pose.translation, there.rotation * (point - origin));
        assert!((a - (b + there.translation)).length() < 1e-9);
        assert!((there.absolute_from(origin).translation - pose.translation).length() < 1e-9);
    }
}
