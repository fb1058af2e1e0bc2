//! The truth map: how far the picture that the topside shows is from what the camera saw, block by block.
//!
//! The vehicle knows both pictures. It compares them in *windows* of 16×16 pixels, at all places. A block of 16×16
//! pixels has the level of the worst window whose centre lies in it, by the root of the mean squared error over the
//! window's pixels and colours (RMS), values of 0 to 255. Masked pixels have no error. A block at the picture's edge
//! that is smaller counts as a window, too.
//!
//! | level | name | meaning |
//! |---|---|---|
//! | 0 | as seen | no window is off by more than the first threshold |
//! | 1 | differs | some window is off by more than that, none by more than the second |
//! | 2 | wrong | some window is off by more than the second threshold, or the map was too coarse to say less |
//! | 3 | not seen | nothing is known: no map came, or the difference picture that it is about did not |
//!
//! A map never says less than what is true. It says more of a block if that saves enough bytes: see `choice`. If it
//! is still too long for its packet, several blocks share a cell of the map, which has the highest of their levels.
//!
//! **A packet that is cut.** The map is in front of the difference picture. If the end of that is missing, the picture
//! is another than the one that was compared. So each block that is as seen has a *mark*: whether the render alone, the
//! prior's picture, shows it as well. It does if no window of the render is off by more than 4/5 of the first
//! threshold. Such a block stays as seen if what came has changed no window of the render by more than the other fifth.
//! Then no window can be off by more than the threshold. All other blocks are then not seen.
//!
//! The map's bytes, and the chances of its bits: `docs/format/packet.md`.
//!
//! If the last key map that is held is not the one that a map is predicted from, the map is lost: all blocks are not
//! seen. So a packet that is lost costs no other packet its map, unless it held a key map.

mod choice;
mod coding;
mod decoder;
#[cfg(feature = "encode")]
mod encoder;
mod marks;
mod overlay;
mod table;
#[cfg(feature = "inspection")]
pub mod training;

pub use decoder::{Arrived, TruthDecoder};
#[cfg(feature = "encode")]
pub(crate) use encoder::{Base, Compared, TruthEncoder};

/// Side of a block, pixels.
pub const BLOCK: u32 = 16;

/// Thresholds of the levels 1 and 2, RMS, by their number in a map.
pub const THRESHOLDS: [[f32; 2]; 4] = [[16.0, 28.0], [12.0, 21.0], [20.0, 35.0], [8.0, 14.0]];

/// What the truth map says of a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum TruthLevel {
    /// The picture shows what the camera saw.
    AsSeen = 0,
    /// It differs.
    Differs = 1,
    /// It is wrong.
    Wrong = 2,
    /// Nothing is known of it: it is memory.
    NotSeen = 3,
}

/// What is known of a picture, block by block.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TruthMap {
    /// Blocks in a row: a block has [`BLOCK`] pixels a side.
    pub columns: u32,
    /// Rows of blocks.
    pub rows: u32,
    /// Levels of the blocks, row by row: see [`TruthLevel`].
    pub levels: Vec<u8>,
    /// The thresholds of the levels 1 and 2, RMS of 255; `None`: no map came, and all is not seen.
    pub thresholds: Option<[f32; 2]>,
}

impl TruthMap {
    /// Of a picture of which nothing is known.
    pub fn not_seen(width: u32, height: u32) -> TruthMap {
        let mut map = TruthMap::default();
        map.reset(width, height);
        map
    }

    /// Makes it one of a picture of which nothing is known.
    pub fn reset(&mut self, width: u32, height: u32) {
        (self.columns, self.rows) = (width.div_ceil(BLOCK), height.div_ceil(BLOCK));
        self.thresholds = None;
        self.levels.clear();
        self.levels.resize((self.columns * self.rows) as usize, TruthLevel::NotSeen as u8);
    }

    /// Becomes the same as another one, in its own memory.
    pub fn copy(&mut self, other: &TruthMap) {
        (self.columns, self.rows, self.thresholds) = (other.columns, other.rows, other.thresholds);
        self.levels.clone_from(&other.levels);
    }

    /// Number of blocks of a level.
    pub fn count(&self, level: TruthLevel) -> usize {
        self.levels.iter().filter(|found| **found == level as u8).count()
    }
}

#[cfg(test)]
mod tests;
