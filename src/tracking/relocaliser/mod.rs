//! Finds a lost camera again: where, among the prior's key frames, the frame was taken.
//!
//! The prior is rendered at its key frames. Corners of these renders get descriptors ([`features`]) and, from the
//! rendered depth, world points ([`landmarks`]). A frame's corners vote for key frames. Matches with the corners of
//! those key frames give poses ([`resection`]). The prior is rendered at such a pose. This render is nearer to the
//! frame than any key frame: its corners are matched again and give a better pose. All of it works for any roll, for
//! any gain and offset of the light, and if a part of the picture differs.

mod descriptor;
mod features;
mod landmarks;
mod p3p;
mod places;
mod resection;

use glam::DVec3;

use crate::image::Mask;
use crate::shared::PIXEL;
use crate::vulkan::Error;
use crate::{Camera, Picture, Pose};

use super::Objective;
use super::hypotheses::luma;
use descriptor::{Descriptor, distance};
use features::{Extractor, Feature};
use landmarks::Landmarks;
pub use places::{Alike, Places};
use resection::{Around, Match, Resection, TURNED, axis};

/// Most corners of a frame.
const FEATURES: usize = 1000;
/// Most corners of a key frame.
const KEY_FEATURES: usize = 800;
/// Fewest corners of a key frame, if there are very many key frames.
const MIN_KEY_FEATURES: usize = 120;
/// Memory for the points of all key frames, bytes; more if [`MIN_KEY_FEATURES`] per key frame need it.
const MEMORY: usize = 48 << 20;
/// How many key frames, those with most votes, have their corners compared with the frame's.
const VOTED: usize = 64;
const PROPOSALS: usize = 6;
/// Key frames that stand nearer to another than this, in depths of the scene, propose poses together with it. A pose
/// that one key frame proposes by itself must be as near to it.
const TOGETHER: f64 = 0.8;
/// The nearest descriptor counts only if its distance is less than this share of the second nearest's.
const DISTINCT: f32 = 0.85;
/// As [`DISTINCT`], for a render at a pose proposed for the frame.
const DISTINCT_NEAR: f32 = 0.9;
/// At most this many key frames, those with most matches, pool their matches.
const POOLED: usize = 32;
/// Descriptors of one point differ in at most this many bits. Poses are proposed with the strict number and with the
/// loose one, which gives more right matches, but many more wrong ones.
const ALIKE: [u32; 2] = [50, 66];
/// As [`ALIKE`], for a render at a pose proposed for the frame.
const ALIKE_NEAR: u32 = 64;
/// Fewer corners are explained by wrong poses too.
const CHANCE: u32 = 8;
/// Poses that come of key frames compared one by one.
const COMPARED: usize = 8;
/// Renders at a proposed pose.
const ROUNDS: usize = 3;
/// Pictures are not looked at in more detail than this width, pixels.
const WIDTH: u32 = 320;

/// Corners this close to a masked pixel are left out, pixels.
const MASK_EDGE: f32 = 3.0;

/// A pose that may be the frame's, and how many of the frame's corners it explains.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// World-to-camera.
    pub pose: Pose,
    /// Corners of the frame that the prior, at this pose, shows within three pixels of their place.
    pub features: u32,
}

/// Finds cameras by the key frames of a prior. Takes all its memory when it is made.
pub struct Relocaliser {
    level: usize,
    factor: usize,
    camera: Camera,
    origin: DVec3,
    key_frames: Vec<Pose>,
    /// Median depth of the corners of each key frame that was rendered; 0 if it has no corners.
    depths: Vec<f64>,
    key_features: usize,
    landmarks: Landmarks,
    extractor: Extractor,
    /// Which pixels of the frame count, at the level; `None`: all do.
    mask: Option<Mask>,
    resection: Resection,
    luma: Vec<f32>,
    frame: Vec<Feature>,
    render: Vec<Feature>,
    /// Points of the render's corners, relative to the origin. Not a number if nothing is seen there.
    points: Vec<[f32; 3]>,
    votes: Vec<(u32, u32)>,
    /// With the distances of their descriptors.
    by_key_frame: Vec<Vec<(u32, Match)>>,
    matches: Vec<Match>,
    /// Number of strict matches, and place in `votes`; most first.
    ranked: Vec<(usize, usize)>,
    pairs: Pairs,
    sorted: Vec<f64>,
    candidates: Vec<Candidate>,
}

/// Points that are kept of each of so many key frames.
fn key_features(key_frames: usize) -> usize {
    let each = MEMORY / Landmarks::bytes(key_frames.max(1), 1);
    each.clamp(MIN_KEY_FEATURES, KEY_FEATURES)
}

impl Relocaliser {
    /// For the camera of an objective, with the prior's key frames. Nothing is rendered yet.
    pub fn new(objective: &mut Objective, key_frames: &[Pose]) -> Relocaliser {
        let detailed = |level: &usize| objective.camera(*level).width >= WIDTH;
        let level = (0..objective.levels()).rev().find(detailed).unwrap_or(0);
        let camera = objective.camera(level);
        let key_features = key_features(key_frames.len());
        let origin = objective.renderer().scene().centre();
        let (width, height) = (camera.width as usize, camera.height as usize);
        // Each level rounds its share.
        let room = FEATURES + 16;
        Relocaliser {
            level,
            factor: objective.factor(level) as usize,
            camera,
            origin,
            key_frames: key_frames.iter().map(|pose| pose.relative_to(origin)).collect(),
            depths: Vec::with_capacity(key_frames.len()),
            key_features,
            landmarks: Landmarks::with_room(key_frames.len(), key_features),
            extractor: Extractor::new(width, height, FEATURES),
            mask: None,
            resection: Resection::new(&camera, room),
            luma: vec![0.0; camera.pixels()],
            frame: Vec::with_capacity(room),
            render: Vec::with_capacity(room),
            points: Vec::with_capacity(room),
            votes: Vec::with_capacity(key_frames.len()),
            by_key_frame: (0..VOTED).map(|_| Vec::with_capacity(room)).collect(),
            matches: Vec::with_capacity(VOTED * room),
            ranked: Vec::with_capacity(VOTED),
            pairs: Pairs::with_room(room),
            sorted: Vec::with_capacity(room),
            candidates: Vec::with_capacity((ALIKE.len() * PROPOSALS).max(COMPARED + 1)),
        }
    }

    /// Bytes that the points of so many key frames take at most.
    pub fn landmark_bytes(key_frames: usize) -> usize {
        match key_frames {
            0 => 0,
            _ => Landmarks::bytes(key_frames, key_features(key_frames)),
        }
    }

    /// Key frames that are not rendered yet.
    pub fn left(&self) -> usize {
        self.key_frames.len() - self.landmarks.groups()
    }

    /// Renders the next `max` key frames and takes their corners: one render each.
    pub fn learn(&mut self, objective: &mut Objective, max: usize) -> Result<(), Error> {
        for _ in 0..max.min(self.left()) {
            let pose = self.key_frames[self.landmarks.groups()];
            self.look(objective, &pose)?;
            self.sorted.clear();
            let seen = self.points.iter().filter(|p| p[0].is_finite());
            self.sorted.extend(seen.map(|p| (pose.rotation * vector(p) + pose.translation).z));
            self.sorted.sort_unstable_by(f64::total_cmp);
            self.depths.push(self.sorted.get(self.sorted.len() / 2).copied().unwrap_or(0.0));
            // Corners are ordered by level. If there are too many for the room, they are left out evenly.
            let (seen, room) = (self.sorted.len().max(1), self.key_features);
            let valid = self.points.iter().zip(&self.render).filter(|(p, _)| p[0].is_finite());
            let kept = valid
                .enumerate()
                .filter(|(i, _)| i * room / seen != (i + 1) * room / seen || seen <= room);
            self.landmarks.add(kept.map(|(_, (p, f))| (*p, f.descriptor)));
        }
        Ok(())
    }

    /// Takes the corners of a frame, of the size of the objective's full picture.
    pub fn set_frame(&mut self, frame: &Picture) {
        let (factor, width) = (self.factor, self.camera.width as usize);
        let stride = frame.width as usize * 3;
        let scale = 1.0 / (255.0 * (factor * factor) as f32);
        for (i, to) in self.luma.iter_mut().enumerate() {
            let first = i / width * factor * stride + i % width * factor * 3;
            let rows = (0..factor)
                .flat_map(|row| frame.data[first + row * stride..][..factor * 3].chunks_exact(3));
            *to = scale
                * rows.map(|rgb| luma(&[rgb[0].into(), rgb[1].into(), rgb[2].into()])).sum::<f32>();
        }
        self.extractor.extract(&self.luma, &mut self.frame);
        if let Some(mask) = &self.mask {
            self.frame.retain(|feature| counts_around(mask, feature.place));
        }
    }

    /// Sets which pixels of frames count from here on; `None`: all do. The frames themselves must be level where none
    /// does.
    pub fn set_mask(&mut self, mask: Option<&Mask>) {
        self.mask = mask.map(|mask| mask.reduced(self.factor as u32));
    }

    /// Poses that the key frames rendered so far propose for the frame, best first. Ends early once `goes_on` is false.
    pub fn propose(&mut self, mut goes_on: impl FnMut() -> bool) -> &[Candidate] {
        self.candidates.clear();
        self.landmarks.vote(&self.frame, &mut self.votes);
        self.votes.truncate(VOTED);
        for slot in 0..self.votes.len() {
            if !goes_on() {
                self.votes.truncate(slot);
                break;
            }
            self.compare(slot);
        }
        self.ranked.clear();
        for (slot, matches) in self.by_key_frame[..self.votes.len()].iter().enumerate() {
            let strict = matches.iter().filter(|(d, _)| *d <= ALIKE[0]).count();
            self.ranked.push((strict, slot));
        }
        self.ranked.sort_unstable_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
        for alike in ALIKE {
            for rank in 0..self.ranked.len().min(PROPOSALS) {
                if !goes_on() {
                    break;
                }
                self.pool(self.ranked[rank].1, alike);
                if let Some(found) = self.resection.resect(&self.matches, None, None) {
                    let pose = found.pose.absolute_from(self.origin);
                    self.candidates.push(Candidate { pose, features: found.features });
                }
            }
        }
        let by_features = |candidate: &Candidate| std::cmp::Reverse(candidate.features);
        self.candidates.sort_unstable_by_key(by_features);
        &self.candidates
    }

    /// Poses that single key frames propose, best first: for frames that no vote leads to. Compares about `max` key
    /// frames with the frame, other ones in each `turn`, until each had its turn. Ends early once `goes_on` is false.
    pub fn compare_some(
        &mut self,
        max: usize,
        turn: usize,
        mut goes_on: impl FnMut() -> bool,
    ) -> &[Candidate] {
        self.candidates.clear();
        let parts = self.landmarks.groups().div_ceil(max.max(1)).max(1);
        for index in (turn % parts..self.landmarks.groups()).step_by(parts) {
            if !goes_on() {
                break;
            }
            self.match_key_frame(index);
            let key_frame = &self.key_frames[index];
            let reach = TOGETHER * self.depths[index];
            let around = Around { centre: key_frame.centre(), reach, axis: axis(key_frame) };
            if let Some(found) = self.resection.resect(&self.matches, None, Some(&around)) {
                let (pose, features) = (found.pose.absolute_from(self.origin), found.features);
                let at = self.candidates.partition_point(|better| better.features >= features);
                self.candidates.insert(at, Candidate { pose, features });
                self.candidates.truncate(COMPARED);
            }
        }
        &self.candidates
    }

    /// The key frame that looks most like the frame, or any: a search needs some start.
    pub fn likeliest(&self) -> Option<Pose> {
        self.likely(0).or_else(|| Some(self.key_frames.first()?.absolute_from(self.origin)))
    }

    /// The key frame of rank `rank` by matches, of those that were compared with the frame; rank 0 has most. After
    /// the last rank the first follows again.
    pub fn likely(&self, rank: usize) -> Option<Pose> {
        let (_, slot) = *self.ranked.get(rank.checked_rem(self.ranked.len())?)?;
        let key_frame = self.votes[slot].0 as usize;
        Some(self.key_frames[key_frame].absolute_from(self.origin))
    }

    /// Improves a pose with renders at it, at most `max`, as long as each explains more of the frame's corners. `None`
    /// if too few corners match.
    pub fn approach(
        &mut self,
        objective: &mut Objective,
        from: &Pose,
        max: usize,
    ) -> Result<Option<Candidate>, Error> {
        let mut at = from.relative_to(self.origin);
        let mut best: Option<Candidate> = None;
        for _ in 0..max.min(ROUNDS) {
            self.look(objective, &at)?;
            self.match_render();
            let Some(found) = self.resection.resect(&self.matches, Some(at), None) else { break };
            let before = best.map_or(0, |best| best.features);
            if found.features > before {
                let pose = found.pose.absolute_from(self.origin);
                best = Some(Candidate { pose, features: found.features });
                at = found.pose;
            }
            // A tenth more is worth another render, unless all of it may be chance.
            if found.features * 10 <= before * 11 || found.features < CHANCE {
                break;
            }
        }
        Ok(best)
    }

    /// How many of the frame's corners a pose explains, by what was matched last.
    pub fn explained(&mut self, pose: &Pose) -> u32 {
        self.resection.count(&self.matches, &pose.relative_to(self.origin))
    }

    /// Renders the prior and takes the corners with their points.
    fn look(&mut self, objective: &mut Objective, pose: &Pose) -> Result<(), Error> {
        let (level, Camera { width, height, fx, fy, cx, cy }) = (self.level, self.camera);
        let render = objective.renderer().draw_level(level, &pose.absolute_from(self.origin))?;
        let pixels = render.chunks_exact(PIXEL as usize);
        for (to, pixel) in self.luma.iter_mut().zip(pixels) {
            *to = luma(&[pixel[0], pixel[1], pixel[2]].map(|v| v.clamp(0.0, 1.0)));
        }
        self.extractor.extract(&self.luma, &mut self.render);
        let back = pose.inverse();
        self.points.clear();
        for Feature { place: [x, y], .. } in &self.render {
            let (column, row) = ((*x as u32).min(width - 1), (*y as u32).min(height - 1));
            let pixel = &render[(row * width + column) as usize * PIXEL as usize..];
            let opacity = f64::from(1.0 - pixel[4]);
            let z = if opacity > 0.5 { f64::from(pixel[3]) / opacity } else { f64::NAN };
            let p = DVec3::new(f64::from((x - cx) / fx) * z, f64::from((y - cy) / fy) * z, z);
            self.points.push((back.rotation * p + back.translation).to_array().map(|v| v as f32));
        }
        Ok(())
    }

    /// Matches the frame's corners with those of the key frame of rank `slot` by votes.
    fn compare(&mut self, slot: usize) {
        let (points, descriptors) = self.landmarks.group(self.votes[slot].0 as usize);
        let pairs = self.pairs.between(&self.frame, descriptors.iter(), ALIKE[1], DISTINCT);
        let matches = &mut self.by_key_frame[slot];
        matches.clear();
        matches.extend(pairs.map(|(index, at)| {
            let Feature { place, descriptor } = self.frame[index];
            let point = vector(&points[at]);
            let of = Match { feature: index as u32, place, point };
            (distance(&descriptor, &descriptors[at]), of)
        }));
    }

    /// Gathers the matches of a key frame, and of others near it, whose descriptors are `alike`.
    fn pool(&mut self, slot: usize, alike: u32) {
        let at = |slot: usize| self.votes[slot].0 as usize;
        let here = &self.key_frames[at(slot)];
        let reach = TOGETHER * self.depths[at(slot)];
        self.matches.clear();
        for rank in 0..self.ranked.len().min(POOLED) {
            let other = self.ranked[rank].1;
            let there = &self.key_frames[at(other)];
            let near = (here.centre() - there.centre()).length() < reach;
            let same_way = axis(here).dot(axis(there)) > TURNED;
            if other == slot || (near && same_way) {
                let valid = self.by_key_frame[other].iter().filter(|(d, _)| *d <= alike);
                self.matches.extend(valid.map(|(_, of)| *of));
            }
        }
    }

    /// Matches the frame's corners with those of a key frame, as with a render there.
    fn match_key_frame(&mut self, index: usize) {
        let (points, descriptors) = self.landmarks.group(index);
        let pairs = self.pairs.between(&self.frame, descriptors.iter(), ALIKE_NEAR, DISTINCT_NEAR);
        self.matches.clear();
        self.matches.extend(pairs.map(|(index, at)| Match {
            feature: index as u32,
            place: self.frame[index].place,
            point: vector(&points[at]),
        }));
    }

    /// Matches the frame's corners with the render's.
    fn match_render(&mut self) {
        let render = self.render.iter().map(|f| &f.descriptor);
        let pairs = self.pairs.between(&self.frame, render, ALIKE_NEAR, DISTINCT_NEAR);
        self.matches.clear();
        let valid = pairs.filter(|(_, at)| self.points[*at][0].is_finite());
        self.matches.extend(valid.map(|(index, at)| Match {
            feature: index as u32,
            place: self.frame[index].place,
            point: vector(&self.points[at]),
        }));
    }
}

/// Whether all pixels around a place count: else the mask's edge may have made the corner.
fn counts_around(mask: &Mask, [x, y]: [f32; 2]) -> bool {
    let span = |at: f32, side: u32| {
        (at - MASK_EDGE).max(0.0) as usize..=((at + MASK_EDGE) as usize).min(side as usize - 1)
    };
    let (columns, width) = (span(x, mask.width), mask.width as usize);
    span(y, mask.height).all(|y| columns.clone().all(|x| mask.data[y * width + x]))
}

/// Pairs of descriptors that are each other's nearest.
#[derive(Default)]
struct Pairs {
    /// For each feature, the nearest descriptor if it counts.
    nearest: Vec<Option<u32>>,
    /// For each descriptor, the distance of the nearest feature, and its index.
    back: Vec<(u32, u32)>,
}

impl Pairs {
    fn with_room(features: usize) -> Pairs {
        Pairs { nearest: Vec::with_capacity(features), back: Vec::with_capacity(features) }
    }

    /// Pairs of a feature and a descriptor that are each other's nearest and differ in at most `alike` bits. The
    /// difference must also be less than `share` of that of the feature's second nearest.
    fn between<'a>(
        &mut self,
        features: &[Feature],
        descriptors: impl Iterator<Item = &'a Descriptor> + Clone,
        alike: u32,
        share: f32,
    ) -> impl Iterator<Item = (usize, usize)> {
        self.nearest.clear();
        self.back.clear();
        self.back.extend(descriptors.clone().map(|_| (u32::MAX, 0)));
        for (index, feature) in features.iter().enumerate() {
            let (mut at, mut min, mut second) = (0, u32::MAX, u32::MAX);
            for ((i, d), back) in descriptors.clone().enumerate().zip(&mut self.back) {
                let d = distance(d, &feature.descriptor);
                if d < back.0 {
                    *back = (d, index as u32);
                }
                if d < min {
                    (at, min, second) = (i, d, min);
                } else if d < second {
                    second = d;
                }
            }
            let distinct = min <= alike && (min as f32) < share * second as f32;
            self.nearest.push(distinct.then_some(at as u32));
        }
        let pairs = self.nearest.iter().enumerate();
        pairs.filter_map(|(index, at)| {
            let at = (*at)? as usize;
            (self.back[at].1 == index as u32).then_some((index, at))
        })
    }
}

fn vector(point: &[f32; 3]) -> DVec3 {
    DVec3::from_array(point.map(f64::from))
}
