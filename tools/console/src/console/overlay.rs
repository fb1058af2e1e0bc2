//! What may be believed of the picture, block by block.

use std::path::Path;

use nvsprior::prior::Doubt;
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
    pub fn new(
        engine: &Engine,
        prior: &Prior,
        doubt: Option<&Doubt>,
    ) -> anyhow::Result<MemoryView> {
        Ok(MemoryView { view: DoubtView::new(engine, prior, doubt)?, map: DoubtMap::default() })
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

/// The doubt beside a prior. If it cannot be read, says so; the console is worth more.
pub fn doubt_beside(path: &Path, prior: &Prior) -> Option<Doubt> {
    match Doubt::open_beside(path, prior) {
        Ok(Some(doubt)) => return Some(doubt),
        Ok(None) => eprintln!("{}: not there", Doubt::path_beside(path).display()),
        Err(error) => eprintln!("{error}"),
    }
    eprintln!("so all that is mapped is doubtful where it was not seen: `nvsprior doubt`");
    None
}
