//! Truth maps read.

use crate::packet::{Latent, truth as layout};
use crate::range_coder::WholeReader;

use super::coding::code;
use super::marks::{Comparison, Mark, Marks, RENDERED};
use super::{THRESHOLDS, TruthLevel, TruthMap};

/// Reads the truth maps of pictures of one size, in memory of its own.
pub struct TruthDecoder {
    marks: Marks,
    /// Cells of a map and of the key map, as they are read.
    cells: [Marks; 2],
    /// What the last key map said, and of which frame.
    key: Marks,
    key_frame: Option<u32>,
    comparison: Comparison,
}

/// How much of the difference picture that a map is about has come.
pub enum Arrived<'a> {
    /// All of it.
    All,
    /// Its end is missing. What it made of the render, both as values of three colours, row by row.
    Start {
        /// The render.
        render: &'a [u8],
        /// The render with what came of the difference picture.
        picture: &'a [u8],
    },
}

impl TruthDecoder {
    /// Makes one for pictures of a size.
    pub fn new(width: u32, height: u32) -> TruthDecoder {
        let marks = Marks::new(width, height);
        let (key, cells) = (marks.clone(), [marks.clone(), marks.clone()]);
        let comparison = Comparison::new(width, height);
        TruthDecoder { marks, cells, key, key_frame: None, comparison }
    }

    /// Reads the map of a frame into `map`, whose size is that of the pictures. If the map cannot be read, or what has
    /// arrived is of another size, all is not seen. Whether it was read.
    pub fn decode(
        &mut self,
        frame: u32,
        bytes: &[u8],
        arrived: Arrived,
        map: &mut TruthMap,
    ) -> bool {
        if let Arrived::Start { render, picture } = arrived
            && [render, picture].iter().any(|values| values.len() != self.comparison.values())
        {
            return false;
        }
        let frame = frame % Latent::FRAMES;
        let Some(thresholds) = self.read(frame, bytes) else { return false };
        if bytes[0] & layout::PREDICTED == 0 {
            self.key.marks.copy_from_slice(&self.marks.marks);
            self.key_frame = Some(frame);
        }
        map.thresholds = Some(thresholds);
        let levels = map.levels.iter_mut().zip(&self.marks.marks);
        match arrived {
            Arrived::All => levels.for_each(|(level, mark)| *level = level_of(*mark) as u8),
            Arrived::Start { render, picture } => {
                let changed = self.comparison.worst(render, picture);
                // By the triangle inequality such a block is off by no more than the threshold.
                let least = (1.0 - RENDERED) * thresholds[0];
                for ((level, mark), changed) in levels.zip(changed) {
                    if *mark == Mark::Rendered && *changed <= least {
                        *level = TruthLevel::AsSeen as u8;
                    }
                }
            }
        }
        true
    }

    /// Reads the marks. Returns the thresholds.
    fn read(&mut self, frame: u32, bytes: &[u8]) -> Option<[f32; 2]> {
        let coded = layout::coded(bytes)?;
        let first = bytes[0];
        let thresholds = THRESHOLDS[usize::from(first >> 6)];
        let (predicted, whole) = (first & layout::PREDICTED != 0, first >> 3 & 1 != 0);
        let side = match first & layout::FORM {
            0 => {
                let mark = if whole { Mark::Mended } else { Mark::Rendered };
                self.marks.marks.fill(mark);
                return Some(thresholds);
            }
            form => 1 << (form - 1),
        };
        let distance = u32::from(bytes[1] >> 4);
        if predicted && self.key_frame != Some(frame.wrapping_sub(distance) % Latent::FRAMES) {
            return None;
        }
        let mut coder = WholeReader::new(&bytes[coded]);
        let [cells, before] = &mut self.cells;
        // It gives the cells their number. Their marks are then read, one by one.
        cells.set_cells_of(&self.marks, side);
        before.set_cells_of(&self.key, side);
        code(&mut coder, whole, predicted.then_some(before), cells);
        self.marks.set_blocks_of(cells, side);
        Some(thresholds)
    }
}

/// The level of a block of a whole picture.
fn level_of(mark: Mark) -> TruthLevel {
    match mark {
        Mark::Rendered | Mark::Mended => TruthLevel::AsSeen,
        Mark::Differs => TruthLevel::Differs,
        Mark::Wrong => TruthLevel::Wrong,
    }
}
