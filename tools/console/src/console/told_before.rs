//! What truth maps told of late about places of the prior, so that it can be found again in a later picture.

use std::collections::VecDeque;

use glam::DVec3;
use nvsprior::truth::{BLOCK, TruthLevel};
use nvsprior::{Camera, Pose};

use super::pictures::Shown;
use super::projection::project;

/// Seconds after which nothing is said any more of what was told.
pub const HOLDS: f64 = 30.0;
/// Most maps that are kept: those of [`HOLDS`] at 15 a second.
const MOST: usize = 450;

/// What was told of a place last: its level, and of when that is, UTC.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Told {
    pub level: u8,
    pub time: f64,
}

/// A truth map, with the camera and the pose of its picture.
struct Map {
    camera: Camera,
    pose: Pose,
    uncertain: bool,
    levels: Vec<u8>,
    time: f64,
}

impl Map {
    /// The level of a place; `None`: the map tells none.
    fn level(&self, place: DVec3) -> Option<u8> {
        let Camera { width, height, .. } = self.camera;
        let [x, y] = project(&self.camera, &self.pose, place, 0.0)?;
        let is_inside = (0.0..width as f32).contains(&x) && (0.0..height as f32).contains(&y);
        let block = y as u32 / BLOCK * width.div_ceil(BLOCK) + x as u32 / BLOCK;
        let level = self.levels.get(block as usize).filter(|_| is_inside);
        level.copied().filter(|level| *level < TruthLevel::NotSeen as u8)
    }
}

/// Maps of late, the newest last.
#[derive(Default)]
pub struct ToldBefore {
    maps: VecDeque<Map>,
}

impl ToldBefore {
    /// Takes a picture's map, if one came. What is too old is forgotten.
    pub fn take(&mut self, shown: &Shown) {
        let oldest = shown.arrived - HOLDS;
        let is_past = |map: &mut Map| map.time < oldest;
        let mut spare = None;
        while self.maps.len() == MOST || self.maps.front_mut().is_some_and(is_past) {
            spare = self.maps.pop_front();
        }
        let decoded = &shown.decoded;
        if decoded.truth.thresholds.is_none() {
            return;
        }
        // The buffer of a map before is used again.
        let mut levels = spare.map_or(Vec::new(), |map| map.levels);
        levels.clone_from(&decoded.truth.levels);
        // A vehicle whose clock is wrong may say that its picture is of tomorrow.
        let time = shown.exposed.min(shown.arrived);
        let (camera, pose, uncertain) = (shown.camera, decoded.pose, decoded.uncertain);
        self.maps.push_back(Map { camera, pose, uncertain, levels, time });
    }

    /// What was told last of a place. Of a picture that is certain of its pose, only others that are know its places.
    pub fn of(&self, place: DVec3, uncertain: bool) -> Option<Told> {
        let maps = self.maps.iter().rev().filter(|map| uncertain || !map.uncertain);
        maps.map(|map| map.level(place).map(|level| Told { level, time: map.time }))
            .find_map(|told| told)
    }
}
