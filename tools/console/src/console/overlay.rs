//! What may be believed of the picture, block by block.

use nvsprior::truth::TruthLevel;
use nvsprior::{Decoded, DoubtMap, DoubtView, Engine, Prior};
use serde::Serialize;

use super::pictures::Shown;

/// Levels of blocks: 0 as seen, 1 differs, 2 wrong; not seen: 3 memory and the prior is sure of it, 4 it is doubtful,
/// 5 it was never mapped.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Overlay {
    pub columns: usize,
    /// By block, row by row.
    pub levels: Vec<u8>,
    /// The picture's packet told what is as seen; else all is memory.
    pub has_map: bool,
}

/// Draws what is known of memory.
pub struct MemoryView {
    view: DoubtView,
    map: DoubtMap,
}

impl MemoryView {
    pub fn new(engine: &Engine, prior: &Prior) -> anyhow::Result<MemoryView> {
        Ok(MemoryView { view: DoubtView::new(engine, prior)?, map: DoubtMap::default() })
    }

    /// The overlay of a picture.
    pub fn overlay(&mut self, shown: &Shown) -> anyhow::Result<Overlay> {
        let Decoded { truth, pose, .. } = &shown.decoded;
        let mut levels = truth.levels.clone();
        if levels.contains(&(TruthLevel::NotSeen as u8)) {
            self.view.draw(&shown.camera, pose, &mut self.map)?;
            for (level, doubt) in levels.iter_mut().zip(&self.map.levels) {
                if *level == TruthLevel::NotSeen as u8 {
                    *level += doubt;
                }
            }
        }
        let has_map = truth.thresholds.is_some();
        Ok(Overlay { columns: truth.columns as usize, levels, has_map })
    }
}
