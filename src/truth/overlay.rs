//! The truth map drawn over its picture: colours and patterns that the colour-blind can tell.

use crate::Picture;

use super::{BLOCK, TruthLevel, TruthMap};

const YELLOW: [u8; 3] = [255, 220, 0];
/// Beside the yellow lines, so that they can be seen on what is yellow.
const DARK: [u8; 3] = [20, 20, 20];
const MAGENTA: [u8; 3] = [255, 0, 200];
const LIGHT: [u8; 3] = [230; 3];
/// Pixels from one line of a pattern to the next. A block holds a whole number of them.
const STEP: u32 = 8;

impl TruthMap {
    /// Draws the map over its picture. Yellow and dark stripes: the block differs. Magenta lattice: it is wrong.
    /// Grey, with dots: nothing is known of it. Blocks that are as seen stay as they are. A picture of another size
    /// stays, too.
    pub fn draw_over(&self, picture: &mut Picture) {
        let (width, height) = (picture.width, picture.height);
        if (width.div_ceil(BLOCK), height.div_ceil(BLOCK)) != (self.columns, self.rows) {
            return;
        }
        for (at, rgb) in (0..).zip(picture.data.as_chunks_mut::<3>().0) {
            let (x, y): (u32, u32) = (at % width, at / width);
            let level = self.levels[(y / BLOCK * self.columns + x / BLOCK) as usize];
            let stripe = (x + y).is_multiple_of(STEP);
            let beside = (x + y) % STEP == 1;
            let other_stripe = (x + BLOCK - y % BLOCK).is_multiple_of(STEP);
            match level {
                level if level == TruthLevel::Differs as u8 && stripe => *rgb = YELLOW,
                level if level == TruthLevel::Differs as u8 && beside => *rgb = DARK,
                level if level == TruthLevel::Wrong as u8 && (stripe || other_stripe) => {
                    *rgb = MAGENTA;
                }
                level if level == TruthLevel::NotSeen as u8 => {
                    let grey = (rgb.iter().map(|v| u16::from(*v)).sum::<u16>() / 3) as u8;
                    let dot = x.is_multiple_of(STEP) && y.is_multiple_of(STEP);
                    *rgb = if dot { LIGHT } else { [grey; 3] };
                }
                _ => {}
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const COLOUR: [u8; 3] = [20, 60, 100];

    fn coloured(width: u32, height: u32) -> Picture {
        let mut picture = Picture::new(width, height);
        picture.data.as_chunks_mut::<3>().0.fill(COLOUR);
        picture
    }

    #[test]
    fn each_level_has_a_pattern_of_its_own() {
        let mut shown = coloured(64, 16);
        let mut map = TruthMap::not_seen(64, 16);
        map.levels = vec![0, 1, 2, 3];
        map.draw_over(&mut shown);
        let changed = |block: usize| {
            let pixels = shown.data.as_chunks::<3>().0.iter().enumerate();
            let of_block = pixels.filter(|(at, _)| at % 64 / 16 == block);
            of_block.filter(|(_, rgb)| **rgb != COLOUR).count()
        };
        assert_eq!(changed(0), 0);
        assert_eq!(changed(1), 64, "two pixels in eight");
        assert!((49..64).contains(&changed(2)), "{}: both ways, where they cross once", changed(2));
        assert_eq!(changed(3), 256);
    }

    #[test]
    fn a_picture_of_another_size_stays() {
        for (width, height) in [(33, 16), (16, 17), (1, 1)] {
            let mut shown = coloured(width, height);
            TruthMap::not_seen(32, 16).draw_over(&mut shown);
            assert_eq!(shown, coloured(width, height));
        }
        // Blocks at the edges may be smaller.
        let mut shown = coloured(17, 3);
        TruthMap::not_seen(17, 3).draw_over(&mut shown);
        assert!(shown.data.as_chunks::<3>().0.iter().all(|rgb| *rgb != COLOUR));
    }
}
