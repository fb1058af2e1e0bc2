//! Truth maps read.

use crate::packet::{Latent, truth as layout};
use crate::range_coder::WholeReader;

use super::coding::code;
use super::marks::{Comparison, Mark, Marks, RENDERED};
use super::{THRESHOLDS, TruthLevel, TruthMap};

/// Reads the truth maps of pictures of one size, in memory of its own.
pub struct TruthDecoder {
    marks: Marks,
    /// Cells of a map and of the one before, as they are read.
    cells: [Marks; 2],
    /// What the last map said, and of which frame.
    last: Marks,
    last_frame: Option<u32>,
    /// What the map before it said: a packet may come again, once more of it has arrived.
    before: Marks,
    frame_before: Option<u32>,
    comparison: Comparison,
}

/// How much of the difference picture that a map is about has come.
pub enum Arrived<'a> {
    All,
    /// Its end is missing. What it made of the render, both as values of three colours, row by row.
    Start {
        render: &'a [u8],
        picture: &'a [u8],
    },
}

impl TruthDecoder {
    pub fn new(width: u32, height: u32) -> TruthDecoder {
        let marks = Marks::new(width, height);
        let (last, before) = (marks.clone(), marks.clone());
        let cells = [marks.clone(), marks.clone()];
        let comparison = Comparison::new(width, height);
        TruthDecoder {
            marks,
            cells,
            last,
            before,
            last_frame: None,
            frame_before: None,
            comparison,
        }
    }

    /// Reads the map of a frame into `map`, whose size is that of the pictures. If the map cannot be read, all is not
    /// seen. Whether it was read.
    pub fn decode(
        &mut self,
        frame: u32,
        bytes: &[u8],
        arrived: Arrived,
        map: &mut TruthMap,
    ) -> bool {
        let frame = frame % Latent::FRAMES;
        if self.last_frame == Some(frame) {
            // It came before.
            std::mem::swap(&mut self.last, &mut self.before);
            self.last_frame = self.frame_before.take();
        }
        let Some(thresholds) = self.read(frame, bytes) else { return false };
        // What was read is the last map now.
        std::mem::swap(&mut self.last, &mut self.before);
        std::mem::swap(&mut self.last, &mut self.marks);
        (self.frame_before, self.last_frame) = (self.last_frame, Some(frame));
        map.thresholds = Some(thresholds);
        let levels = map.levels.iter_mut().zip(&self.last.marks);
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
        let (predicted, whole) = (first >> 4 & 1 != 0, first >> 5 & 1 != 0);
        let side = match (first & layout::FORM) >> 2 {
            0 => {
                let mark = if whole { Mark::Mended } else { Mark::Rendered };
                self.marks.marks.fill(mark);
                return Some(thresholds);
            }
            form => 1 << (form - 1),
        };
        let distance = u32::from(bytes[1] >> 4);
        if predicted && self.last_frame != Some(frame.wrapping_sub(distance) % Latent::FRAMES) {
            return None;
        }
        let mut coder = WholeReader::new(&bytes[coded]);
        let [cells, before] = &mut self.cells;
        // It gives the cells their number. Their marks are then read, one by one.
        cells.set_cells_of(&self.marks, side);
        before.set_cells_of(&self.last, side);
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
