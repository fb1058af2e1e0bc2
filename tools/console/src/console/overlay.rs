//! How far the picture is from what the camera saw, block by block.

use nvsprior::Decoded;
use serde::Serialize;

/// Levels of blocks: 0 as seen, 1 differs, 2 wrong, 3 not seen.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Overlay {
    pub columns: usize,
    /// By block, row by row.
    pub levels: Vec<u8>,
}

/// The overlay of a picture; `None`: its packet tells nothing of it.
pub fn overlay(decoded: &Decoded) -> Option<Overlay> {
    let truth = &decoded.truth;
    truth.thresholds?;
    Some(Overlay { columns: truth.columns as usize, levels: truth.levels.clone() })
}
