//! Preprocessing: what is done to camera pictures of dark, deep scenes before anything else.
//!
//! The paper does the same to its wreck at 476 m: first gray-world white balance, then CLAHE. A prior that was trained on
//! treated pictures says so ([`Prior::preprocessing`](crate::Prior::preprocessing)), and the encoder treats its frames
//! in the same way. The topside shows the treated picture.
//!
//! All of it is integer arithmetic on 8-bit values: a picture gives the same treated picture on every CPU.

mod clahe;
mod white_balance;

use std::fmt;

use super::{Mask, Picture};
use clahe::Equaliser;

/// How camera pictures are treated. White balance comes first, then CLAHE.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Preprocessing {
    /// The white balance.
    pub white_balance: WhiteBalance,
    /// The histogram equalisation; `None`: there is none.
    pub clahe: Option<Clahe>,
}

/// How colours are balanced.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum WhiteBalance {
    /// They stay as they are.
    #[default]
    None,
    /// Gray world (Buchsbaum 1980): each channel gets a gain, so that the means of all three become their common mean.
    /// A gain is at most [`WhiteBalance::MAX_GAIN`], and never below ⅓. It is rounded to 1/4096.
    GrayWorld,
}

impl WhiteBalance {
    /// The largest gain. A dark frame, or one of a single colour, has a channel of little but noise: it stays dark.
    pub const MAX_GAIN: u32 = 4;
}

/// Contrast-limited adaptive histogram equalisation (Zuiderveld 1994), as OpenCV does it, with three differences: tiles
/// are as equal as whole pixels allow, where OpenCV adds mirrored pixels; the clip limit is not rounded to whole pixels;
/// and tiles are as far apart as their middles.
///
/// It changes the luma `Y = 0.299 R + 0.587 G + 0.114 B` and adds the luma's change to all three channels: the
/// differences of the channels (chroma) stay, unless a channel reaches 0 or 255.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clahe {
    clip_limit: f32,
    tiles: u8,
}

impl Default for Clahe {
    /// Clip limit 2, 8×8 tiles.
    fn default() -> Self {
        Clahe { clip_limit: 2.0, tiles: Clahe::TILES }
    }
}

impl Clahe {
    /// The usual number of tiles along either side.
    pub const TILES: u8 = 8;
    /// Most tiles along either side.
    pub const MAX_TILES: u8 = 32;
    /// The largest clip limit: with it nothing is clipped.
    pub const MAX_CLIP_LIMIT: f32 = 256.0;

    /// `clip_limit`: how much larger than the mean a bin of a tile's histogram may be, 1 to 256; so the contrast grows
    /// by this factor at most. It is rounded to 1/256. `tiles`: along either side of the picture, 1 to 32. A side of
    /// fewer pixels than that has a tile per pixel.
    pub fn new(clip_limit: f32, tiles: u8) -> Result<Clahe, PreprocessingError> {
        if !(1.0..=Self::MAX_CLIP_LIMIT).contains(&clip_limit) {
            return Err(PreprocessingError::ClipLimit { found: clip_limit });
        }
        if !(1..=Self::MAX_TILES).contains(&tiles) {
            return Err(PreprocessingError::Tiles { found: tiles });
        }
        Ok(Clahe { clip_limit: (clip_limit * 256.0).round() / 256.0, tiles })
    }

    /// How much larger than the mean a bin of a tile's histogram may be.
    pub fn clip_limit(&self) -> f32 {
        self.clip_limit
    }

    /// Tiles along either side of the picture.
    pub fn tiles(&self) -> u8 {
        self.tiles
    }
}

/// Why there is no such preprocessing.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PreprocessingError {
    /// The clip limit lies outside its range.
    #[error("CLAHE with a clip limit of {found}: at least 1, at most {}", Clahe::MAX_CLIP_LIMIT)]
    ClipLimit {
        /// The clip limit.
        found: f32,
    },
    /// The number of tiles lies outside its range.
    #[error("CLAHE with {found} tiles along a side: at least 1, at most {}", Clahe::MAX_TILES)]
    Tiles {
        /// The number of tiles.
        found: u8,
    },
}

impl Preprocessing {
    /// Pictures stay as they are.
    pub const NONE: Preprocessing =
        Preprocessing { white_balance: WhiteBalance::None, clahe: None };

    /// Whether pictures stay as they are.
    pub fn is_none(&self) -> bool {
        *self == Preprocessing::NONE
    }
}

impl fmt::Display for Preprocessing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let balance = match self.white_balance {
            WhiteBalance::None => None,
            WhiteBalance::GrayWorld => Some("gray-world white balance"),
        };
        match (balance, self.clahe) {
            (None, None) => f.write_str("none"),
            (Some(balance), None) => f.write_str(balance),
            (balance, Some(Clahe { clip_limit, tiles })) => {
                balance.map_or(Ok(()), |balance| write!(f, "{balance}, then "))?;
                write!(f, "CLAHE with clip limit {clip_limit} in {tiles}×{tiles} tiles")
            }
        }
    }
}

/// Treats pictures.
pub struct Preprocessor {
    white_balance: WhiteBalance,
    equaliser: Option<Equaliser>,
}

impl Preprocessor {
    /// Makes one. It keeps less than 600 KiB, and a byte per pixel of the largest picture.
    pub fn new(preprocessing: &Preprocessing) -> Preprocessor {
        let Preprocessing { white_balance, clahe } = *preprocessing;
        Preprocessor { white_balance, equaliser: clahe.map(Equaliser::new) }
    }

    /// Treats a picture of any size. Allocates nothing if a picture before was as large.
    ///
    /// # Panics
    /// If the picture has not `width · height · 3` bytes.
    pub fn apply(&mut self, picture: &mut Picture) {
        self.apply_by(picture, None);
    }

    /// Treats a picture as [`apply`](Self::apply) does, by those of its pixels that count: the others take part in no
    /// mean and no histogram. `None`: all count.
    ///
    /// # Panics
    /// If the picture has not `width · height · 3` bytes, or the mask another size.
    pub fn apply_by(&mut self, picture: &mut Picture, mask: Option<&Mask>) {
        let sizes = (picture.width, picture.height);
        assert!(mask.is_none_or(|m| (m.width, m.height) == sizes), "size of the mask");
        let counts = mask.map(|mask| &mask.data[..]);
        let expected = picture.width as usize * picture.height as usize * 3;
        assert_eq!(picture.data.len(), expected, "bytes of the picture");
        if picture.data.is_empty() {
            return;
        }
        if self.white_balance == WhiteBalance::GrayWorld {
            white_balance::gray_world(&mut picture.data, counts);
        }
        if let Some(equaliser) = &mut self.equaliser {
            equaliser.apply(picture, counts);
        }
    }
}

#[cfg(test)]
mod tests;
