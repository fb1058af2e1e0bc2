//! Start poses for a frame whose start may be far off, from one render at that start.
//!
//! The frame is rolled by each angle of a grid. Phase correlation with the render gives the shift of each rolled frame,
//! and so a rotation of the camera. Each is then warped by that rotation and correlated again: near the edge of a wide
//! picture, a rotation is no shift. The results are ranked by how well the warped frame correlates with the render,
//! over the pixels that both show. All of it compares luma up to gain and offset: dark frames work as well as bright
//! ones.
//!
//! The errors of the proposals, and what was left out: docs/decisions.md, 2.

use glam::{Mat3, Quat, Vec3};

use super::phase_correlation::PhaseCorrelation;
use crate::shared::PIXEL;
use crate::{Camera, Pose};

/// Turns about the optical axis that are tried, degrees. Phase correlation tolerates 2° of roll and
/// more.
const ROLLS: [f32; 7] = [-12.0, -8.0, -4.0, 0.0, 4.0, 8.0, 12.0];
const ROUNDS: usize = 2;
/// The least share of the picture that frame and render must both show; with less, they are not judged.
const MIN_OVERLAP: f32 = 0.25;

/// A start pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Proposal {
    /// The pose.
    pub pose: Pose,
    /// Correlation of the frame, warped to the pose, with the render: 1 if they are equal up to
    /// gain and offset, −1 if they overlap too little to tell.
    pub score: f32,
}

/// A rotation from the render's camera to the frame's.
#[derive(Clone, Copy)]
struct Candidate {
    rotation: Mat3,
    score: f32,
}

/// Buffers to propose starts with, for pictures of one camera.
pub struct Hypotheses {
    camera: Camera,
    correlation: PhaseCorrelation,
    frame: Vec<f32>,
    render: Vec<f32>,
    /// The frame, warped by each of two candidates, and which pixels it covers.
    warped: [Vec<f32>; 2],
    seen: [Vec<bool>; 2],
    candidates: Vec<Candidate>,
    proposals: Vec<Proposal>,
}

impl Hypotheses {
    /// Most proposals of a call.
    pub const MAX: usize = 4;

    /// For a level's camera. About 80 pixels across are enough, and cheap: 1.2 ms per call.
    pub fn new(camera: &Camera) -> Hypotheses {
        let count = camera.pixels();
        let zeros = || vec![0.0; count];
        Hypotheses {
            camera: *camera,
            correlation: PhaseCorrelation::new(camera.width as usize, camera.height as usize),
            frame: zeros(),
            render: zeros(),
            warped: [zeros(), zeros()],
            seen: [vec![false; count], vec![false; count]],
            candidates: Vec::with_capacity(ROLLS.len() + 1),
            proposals: Vec::with_capacity(Self::MAX),
        }
    }

    /// Poses to start from, best first. The start itself is ranked among them. `frame`: height ×
    /// width × 3 floats; `render`: the prior at `start`, height × width × 5, as a renderer draws
    /// it. Allocates nothing.
    ///
    /// # Panics
    /// If the number of floats is not the camera's.
    pub fn propose(&mut self, frame: &[f32], render: &[f32], start: &Pose) -> &[Proposal] {
        let count = self.camera.pixels();
        assert_eq!((frame.len(), render.len()), (count * 3, count * PIXEL as usize), "floats");
        self.frame.clear();
        self.frame.extend(frame.chunks_exact(3).map(luma));
        self.render.clear();
        self.render.extend(render.chunks_exact(PIXEL as usize).map(luma));
        self.correlation.set_reference(&self.render);

        self.candidates.clear();
        let rolled = |roll: &f32| Mat3::from_rotation_z(roll.to_radians());
        let rolls = ROLLS.iter().map(|roll| Candidate { rotation: rolled(roll), score: 0.0 });
        self.candidates.extend(rolls);
        for _ in 0..ROUNDS {
            self.shift();
        }
        self.candidates.push(Candidate { rotation: Mat3::IDENTITY, score: 0.0 });
        self.judge();

        self.proposals.clear();
        let proposals = self.candidates.iter().take(Self::MAX).map(|candidate| Proposal {
            pose: start.stepped(&candidate.step()),
            score: candidate.score,
        });
        self.proposals.extend(proposals);
        &self.proposals
    }

    /// Turns each candidate by the shift that remains between the frame, warped by it, and the
    /// render.
    fn shift(&mut self) {
        let camera = self.camera;
        for first in (0..self.candidates.len()).step_by(2) {
            // The last one of an odd number goes twice.
            let pair = [first, (first + 1).min(self.candidates.len() - 1)];
            for (slot, at) in pair.into_iter().enumerate() {
                self.warp(slot, self.candidates[at]);
            }
            let shifts = self.correlation.shifts(&self.warped[0], &self.warped[1]);
            let found = if pair[0] == pair[1] { 1 } else { 2 };
            for (at, [dx, dy]) in pair.into_iter().zip(shifts).take(found) {
                let candidate = &mut self.candidates[at];
                let turn = Vec3::new(-dy / camera.fy, dx / camera.fx, 0.0);
                candidate.rotation *= Mat3::from_quat(Quat::from_scaled_axis(turn));
            }
        }
    }

    /// Scores each candidate by the correlation of the frame, warped by it, with the render. Sorts
    /// the best first.
    fn judge(&mut self) {
        for at in 0..self.candidates.len() {
            self.warp(0, self.candidates[at]);
            let min = MIN_OVERLAP * self.render.len() as f32;
            let score = correlation(&self.warped[0], &self.render, &self.seen[0], min);
            self.candidates[at].score = score;
        }
        self.candidates.sort_unstable_by(|a, b| b.score.total_cmp(&a.score));
    }

    /// Warps the frame, bilinearly, into what the render's camera would see if the candidate were
    /// right. Pixels outside the frame get its mean.
    fn warp(&mut self, slot: usize, candidate: Candidate) {
        let Camera { width, height, fx, fy, .. } = self.camera;
        // Samples lie at whole numbers.
        let (cx, cy) = (self.camera.cx - 0.5, self.camera.cy - 0.5);
        let to_picture = Mat3::from_cols(Vec3::X * fx, Vec3::Y * fy, Vec3::new(cx, cy, 1.0));
        let to_ray =
            Mat3::from_cols(Vec3::X / fx, Vec3::Y / fy, Vec3::new(-cx / fx, -cy / fy, 1.0));
        let homography = to_picture * candidate.rotation * to_ray;
        let mean = self.frame.iter().sum::<f32>() / self.frame.len().max(1) as f32;
        let places = (0..height).flat_map(|y| (0..width).map(move |x| (x as f32, y as f32)));
        let to = self.warped[slot].iter_mut().zip(&mut self.seen[slot]);
        for ((x, y), (to, seen)) in places.zip(to) {
            let p = homography * Vec3::new(x, y, 1.0);
            let value = if p.z > 0.0 {
                sample(&self.frame, width as usize, p.x / p.z, p.y / p.z)
            } else {
                None
            };
            (*to, *seen) = (value.unwrap_or(mean), value.is_some());
        }
    }
}

impl Candidate {
    /// The pose step that it stands for.
    fn step(&self) -> [f64; 6] {
        let turn = Quat::from_mat3(&self.rotation).as_dquat().to_scaled_axis();
        [0.0, 0.0, 0.0, turn.x, turn.y, turn.z]
    }
}

/// Luma of a pixel that begins with R, G, B (ITU-R BT.601).
pub(super) fn luma(pixel: &[f32]) -> f32 {
    0.299 * pixel[0] + 0.587 * pixel[1] + 0.114 * pixel[2]
}

/// A picture's value between its samples, rows of `width`; `None` outside of them.
fn sample(picture: &[f32], width: usize, x: f32, y: f32) -> Option<f32> {
    let height = picture.len() / width;
    let inside = (x >= 0.0) & (y >= 0.0) & (x < (width - 1) as f32) & (y < (height - 1) as f32);
    if !inside {
        return None;
    }
    let (column, row) = (x as usize, y as usize);
    let (ax, ay) = (x - column as f32, y - row as f32);
    let at = row * width + column;
    let along = |at: usize| picture[at] + (picture[at + 1] - picture[at]) * ax;
    let (upper, lower) = (along(at), along(at + width));
    Some(upper + (lower - upper) * ay)
}

/// Correlation coefficient of two pictures over the pixels that are `seen`; 0 if one of them is flat, −1 if fewer than
/// `min` pixels are seen or a value is no number.
fn correlation(a: &[f32], b: &[f32], seen: &[bool], min: f32) -> f32 {
    let pixels = || {
        let seen = a.iter().zip(b).zip(seen).filter(|(_, seen)| **seen);
        seen.map(|((a, b), _)| (f64::from(*a), f64::from(*b)))
    };
    let (mut count, mut mean_a, mut mean_b) = (0.0, 0.0, 0.0);
    for (a, b) in pixels() {
        (count, mean_a, mean_b) = (count + 1.0, mean_a + a, mean_b + b);
    }
    if !(count > 0.0 && count >= f64::from(min)) {
        return -1.0;
    }
    (mean_a, mean_b) = (mean_a / count, mean_b / count);
    let (mut aa, mut bb, mut ab) = (0.0, 0.0, 0.0);
    for (a, b) in pixels() {
        let (a, b) = (a - mean_a, b - mean_b);
        (aa, bb, ab) = (aa + a * a, bb + b * b, ab + a * b);
    }
    let score = ab / (aa * bb).max(1e-12).sqrt();
    if score > -1.0 { score.min(1.0) as f32 } else { -1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: Camera = Camera { width: 80, height: 45, fx: 68.6, fy: 68.6, cx: 40.3, cy: 22.3 };
    const DEPTH: f32 = 5.0;

    /// Noise at a lattice's points, between −1 and 1.
    fn lattice(x: i32, y: i32) -> f32 {
        let mut z = (x as u32).wrapping_mul(0x9e37_79b9) ^ (y as u32).wrapping_mul(0x85eb_ca6b);
        z = (z ^ (z >> 15)).wrapping_mul(0xc2b2_ae35);
        (z ^ (z >> 13)) as u16 as f32 / 32_767.5 - 1.0
    }

    /// Luma of a wall at [`DEPTH`]: noise of four sizes.
    fn wall(x: f32, y: f32) -> f32 {
        let octave = |size: f32| {
            let (x, y) = (x / size + 100.0 * size, y / size);
            let (i, j) = (x.floor(), y.floor());
            let (ax, ay) = (x - i, y - j);
            let (i, j) = (i as i32, j as i32);
            let along = |j| lattice(i, j) + (lattice(i + 1, j) - lattice(i, j)) * ax;
            (along(j) + (along(j + 1) - along(j)) * ay) * size.sqrt()
        };
        0.5 + 0.2 * [0.2, 0.4, 0.8, 1.6].map(octave).iter().sum::<f32>()
    }

    /// The wall from a pose, with `floats` floats per pixel: RGB, and what else a renderer gives.
    fn view(pose: &Pose, floats: usize) -> Vec<f32> {
        let rotation = pose.matrix().as_mat3().transpose();
        let centre = pose.centre().as_vec3();
        let pixels = (0..CAMERA.pixels()).flat_map(|i| {
            let (x, y) = ((i % 80) as f32 + 0.5, (i / 80) as f32 + 0.5);
            let ray = Vec3::new((x - CAMERA.cx) / CAMERA.fx, (y - CAMERA.cy) / CAMERA.fy, 1.0);
            let ray = rotation * ray;
            let p = centre + ray * ((DEPTH - centre.z) / ray.z);
            let value = wall(p.x, p.y);
            let depth = (pose.rotation.as_quat() * (p - centre)).z;
            [value, value, value, depth, 0.0].into_iter().take(floats)
        });
        pixels.collect()
    }

    /// Mean distance between the places at which two poses see the wall, pixels.
    fn apart(a: &Pose, b: &Pose) -> f64 {
        let points = (-2..=2).flat_map(|x| (-1..=1).map(move |y| (f64::from(x), f64::from(y))));
        let seen = |pose: &Pose, (x, y): (f64, f64)| {
            let p = pose.rotation * glam::DVec3::new(x, y, f64::from(DEPTH)) + pose.translation;
            f64::from(CAMERA.fx) * p.truncate() / p.z
        };
        points.clone().map(|p| (seen(a, p) - seen(b, p)).length()).sum::<f64>() / 15.0
    }

    fn first(frame: &[f32], truth: &Pose) -> f64 {
        let start = Pose::IDENTITY;
        let mut hypotheses = Hypotheses::new(&CAMERA);
        let found = hypotheses.propose(frame, &view(&start, 5), &start);
        assert_eq!(found.len(), Hypotheses::MAX);
        assert!(found.is_sorted_by(|a, b| a.score >= b.score));
        apart(&found[0].pose, truth)
    }

    fn degrees(tau: [f64; 6]) -> Pose {
        let [a, b, c, d, e, f] = tau;
        Pose::exp(&[a, b, c, d.to_radians(), e.to_radians(), f.to_radians()])
    }

    #[test]
    fn finds_turns_and_rolls() {
        let cases = [
            [0.0; 6],
            [0.0, 0.0, 0.0, 8.0, 0.0, 0.0],
            [0.0, 0.0, 0.0, -3.0, 10.0, 0.0],
            [0.0, 0.0, 0.0, 0.0, 0.0, -10.0],
            [0.0, 0.0, 0.0, 4.0, -7.0, 9.0],
            [0.0, 0.0, 0.5, 0.0, 0.0, 0.0],
            [0.0, 0.0, -0.4, 5.0, 6.0, -6.0],
            [0.3, -0.3, 0.2, -6.0, 6.0, 5.0],
        ];
        for tau in cases {
            let truth = degrees(tau);
            let error = first(&view(&truth, 3), &truth);
            assert!(error < 2.5, "{tau:?}: {error} px of {}", apart(&Pose::IDENTITY, &truth));
        }
    }

    #[test]
    fn dark_and_hazy_frames_do_as_well() {
        let truth = degrees([0.0, 0.0, 0.0, 4.0, -7.0, 9.0]);
        for (gain, haze) in [(0.1, 0.0), (0.1, 0.6)] {
            let eight_bits = |v: f32| ((v * gain + haze) * 255.0).round() / 255.0;
            let frame: Vec<f32> = view(&truth, 3).into_iter().map(eight_bits).collect();
            let error = first(&frame, &truth);
            assert!(error < 1.5, "× {gain} + {haze}: {error} px");
        }
    }

    #[test]
    fn the_start_comes_first_where_nothing_is_better() {
        let start = degrees([0.3, -0.2, 0.1, 20.0, 30.0, -40.0]);
        let mut hypotheses = Hypotheses::new(&CAMERA);
        let same = view(&start, 3);
        let found = hypotheses.propose(&same, &view(&start, 5), &start)[0];
        assert!(found.pose.angle_to(&start) < 1e-3 && found.score > 0.999, "{found:?}");
    }

    #[test]
    fn pictures_that_say_nothing_change_nothing() {
        for value in [0.0, 0.7, f32::NAN, f32::INFINITY] {
            for (width, height) in [(80, 45), (1, 1), (3, 1), (1, 7)] {
                let camera = Camera { width, height, ..CAMERA };
                let (frame, render) =
                    (vec![value; camera.pixels() * 3], vec![value; camera.pixels() * 5]);
                let mut hypotheses = Hypotheses::new(&camera);
                let found = hypotheses.propose(&frame, &render, &Pose::IDENTITY);
                assert!(found.iter().all(|p| p.pose.is_finite() && p.score < 0.1), "{found:?}");
            }
        }
    }

    #[test]
    fn a_second_call_takes_no_room() {
        let truth = degrees([0.0, 0.0, 0.0, 4.0, -7.0, 9.0]);
        let (frame, render) = (view(&truth, 3), view(&Pose::IDENTITY, 5));
        let mut hypotheses = Hypotheses::new(&CAMERA);
        let room = |h: &Hypotheses| {
            let pictures = [h.frame.capacity(), h.render.capacity()];
            (pictures, h.candidates.capacity(), h.proposals.capacity())
        };
        let before = room(&hypotheses);
        let found = hypotheses.propose(&frame, &render, &Pose::IDENTITY).to_vec();
        assert_eq!(room(&hypotheses), before);
        assert_eq!(hypotheses.propose(&frame, &render, &Pose::IDENTITY), found);
    }
}
