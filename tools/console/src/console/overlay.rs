//! What may be believed of the picture, block by block.

use glam::DVec3;
use nvsprior::truth::{BLOCK, TruthLevel};
use nvsprior::{Camera, DoubtMap, DoubtView, Engine, Pose, Prior};
use serde::Serialize;

use super::pictures::Shown;
use super::projection::at_depth;
use super::told_before::{HOLDS, Told, ToldBefore};

/// Levels of blocks: 0 as seen, 1 differs, 2 wrong; not seen: 3 memory and the prior is sure of it, 4 it is doubtful,
/// 5 it was never mapped. 6 differs, 7 wrong: this packet does not tell, but one before told it of the same place.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Overlay {
    pub columns: usize,
    /// By block, row by row.
    pub levels: Vec<u8>,
    /// The picture's packet told what is as seen; else all is memory, or was told before.
    pub has_map: bool,
    /// How long ago the levels 6 and 7 were told, the oldest of them, seconds.
    pub told_ago: Option<f64>,
    /// Blocks of memory that were as seen not long ago, and how long ago, the oldest of them.
    pub seen_before: usize,
    pub seen_ago: Option<f64>,
}

/// From a level to the same one, told before.
const BEFORE: u8 = 5;

/// Draws what is known of memory.
pub struct MemoryView {
    view: DoubtView,
    map: DoubtMap,
    before: ToldBefore,
    columns: usize,
    /// By block: the level that the picture's own packet gives it.
    levels: Vec<u8>,
    /// By block, of those that are not seen: what was told of their places.
    told: Vec<Option<Told>>,
    has_map: bool,
}

impl MemoryView {
    pub fn new(engine: &Engine, prior: &Prior) -> anyhow::Result<MemoryView> {
        Ok(MemoryView {
            view: DoubtView::new(engine, prior)?,
            map: DoubtMap::default(),
            before: ToldBefore::default(),
            columns: 1,
            levels: Vec::new(),
            told: Vec::new(),
            has_map: false,
        })
    }

    /// Takes a picture. It must be the newest one.
    pub fn take(&mut self, shown: &Shown) -> anyhow::Result<()> {
        let truth = &shown.decoded.truth;
        (self.columns, self.has_map) = (truth.columns as usize, truth.thresholds.is_some());
        self.levels.clone_from(&truth.levels);
        self.told.clear();
        self.told.resize(self.levels.len(), None);
        if self.levels.contains(&(TruthLevel::NotSeen as u8)) {
            self.view.draw(&shown.camera, &shown.decoded.pose, &mut self.map)?;
            self.recall(shown);
        }
        self.before.take(shown);
        Ok(())
    }

    /// Finds out what was told before of the blocks that are not seen.
    fn recall(&mut self, shown: &Shown) {
        let DoubtMap { levels: doubts, depths, .. } = &self.map;
        let mapped = || depths.iter().filter(|depth| depth.is_finite());
        // What stands before open water is about as far as the rest.
        let mean = mapped().sum::<f32>() / mapped().count() as f32;
        for (block, level) in self.levels.iter_mut().enumerate() {
            if *level != TruthLevel::NotSeen as u8 {
                continue;
            }
            *level += doubts[block];
            let depth = Some(depths[block]).filter(|depth| depth.is_finite()).unwrap_or(mean);
            let at = [block % self.columns, block / self.columns];
            let place = place_of(&shown.camera, &shown.decoded.pose, at, depth);
            self.told[block] = self.before.of(place, shown.decoded.uncertain);
        }
    }

    /// The overlay of the picture, now.
    pub fn overlay(&self, now: f64) -> Overlay {
        let MemoryView { columns, has_map, .. } = *self;
        let mut overlay =
            Overlay { columns, has_map, levels: self.levels.clone(), ..Default::default() };
        for (level, told) in overlay.levels.iter_mut().zip(&self.told) {
            let Some(Told { level: before, time }) = *told else { continue };
            let age = (now - time).max(0.0);
            if age > HOLDS {
                continue;
            }
            // An old *as seen* says nothing of now.
            let oldest = if before == TruthLevel::AsSeen as u8 {
                overlay.seen_before += 1;
                &mut overlay.seen_ago
            } else {
                *level = before + BEFORE;
                &mut overlay.told_ago
            };
            *oldest = Some(oldest.unwrap_or(0.0).max(age));
        }
        overlay
    }
}

/// The place in the scene that a block's middle shows.
fn place_of(camera: &Camera, pose: &Pose, [column, row]: [usize; 2], depth: f32) -> DVec3 {
    let middle = |at: usize, side: u32| {
        let [from, to] = [at as u32, at as u32 + 1].map(|edge| (edge * BLOCK).min(side));
        f64::from(from + to) / 2.0
    };
    let pixel = [middle(column, camera.width), middle(row, camera.height)];
    at_depth(camera, pose, pixel, depth.into())
}

#[cfg(test)]
mod tests;
