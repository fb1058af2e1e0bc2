//! Preprocessing: what is done to camera pictures of dark, deep scenes before anything else.
//!
//! The paper does the same to its wreck at 476 m: first gray-world white balance, then CLAHE. A prior that was trained
//! on treated pictures says so ([`Prior::preprocessing`](crate::Prior::preprocessing)), and the encoder treats its
//! frames in the same way. The topside shows the treated picture.
//!
//! All of it is integer arithmetic on 8-bit values: a picture gives the same treated picture on every CPU.

mod clahe;
mod white_balance;

use std::fmt;

use super::{Mask, Picture};
use clahe::Equaliser;
pub use clahe::{Clahe, PreprocessingError};
pub use white_balance::WhiteBalance;

/// How camera pictures are treated. White balance comes first, then CLAHE.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Preprocessing {
    /// The white balance.
    pub white_balance: WhiteBalance,
    /// The histogram equalisation; `None`: there is none.
    pub clahe: Option<Clahe>,
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
