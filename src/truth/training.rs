//! Counting marks, for [`table`](super::table).

use crate::Picture;
use crate::range_coder::Probability;

use super::THRESHOLDS;
use super::coding::{Contexts, contexts};
use super::marks::{Comparison, Mark, Marks};
use super::table::{OFF, TAKES, WRONG};

/// How often each bit was one, and how often it was there, by context.
pub struct Counts {
    off: Vec<[u32; 2]>,
    wrong: Vec<[u32; 2]>,
    takes: Vec<[u32; 2]>,
}

impl Default for Counts {
    fn default() -> Counts {
        let none = |len: usize| vec![[0; 2]; len];
        Counts { off: none(OFF.len()), wrong: none(WRONG.len()), takes: none(TAKES.len()) }
    }
}

impl Counts {
    /// Counts the marks of a run's frames: what the camera saw, what the topside shows, and the renders.
    ///
    /// # Panics
    /// If the pictures of a frame differ in size.
    pub fn add_run(&mut self, run: impl Iterator<Item = [Picture; 3]>) {
        let mut before: Option<Marks> = None;
        for [frame, picture, render] in run {
            let (width, height) = (frame.width, frame.height);
            let mut marks = Marks::new(width, height);
            let mut comparison = Comparison::new(width, height);
            comparison.mark(&frame, [&picture, &render], None, THRESHOLDS[0], &mut marks);
            let before = before.replace(marks.clone());
            for side in [1, 2, 4] {
                let [mut cells, mut cells_before] = [marks.clone(), marks.clone()];
                cells.set_cells_of(&marks, side);
                if let Some(before) = &before {
                    cells_before.set_cells_of(before, side);
                }
                for before in [None, before.as_ref().map(|_| &cells_before)] {
                    for (index, mark) in cells.marks.iter().enumerate() {
                        let (column, row) = (index % cells.columns, index / cells.columns);
                        self.count(contexts(&cells, before, column, row), *mark);
                    }
                }
            }
        }
    }

    fn count(&mut self, at: Contexts, mark: Mark) {
        let add = |counts: &mut [u32; 2], bit: bool| {
            counts[0] += u32::from(bit);
            counts[1] += 1;
        };
        add(&mut self.off[at.off], mark.is_off());
        match mark {
            Mark::Differs | Mark::Wrong => add(&mut self.wrong[at.wrong], mark == Mark::Wrong),
            Mark::Rendered | Mark::Mended => add(&mut self.takes[at.takes], mark == Mark::Mended),
        }
    }

    /// The chances that the counts say, of 65,536: of `OFF`, `WRONG` and `TAKES`. Contexts that were seen less count as
    /// if the mean chance had been seen there a few times.
    pub fn chances(&self) -> [Vec<Probability>; 3] {
        [&self.off, &self.wrong, &self.takes].map(|counts| {
            let total = |k: usize| counts.iter().map(|count| f64::from(count[k])).sum::<f64>();
            let mean = (total(0) + 1.0) / (total(1) + 2.0);
            let chance = |[ones, all]: &[u32; 2]| {
                const SEEN: f64 = 4.0;
                let chance = (f64::from(*ones) + SEEN * mean) / (f64::from(*all) + SEEN);
                (chance * 65_536.0).round().clamp(256.0, 65_280.0) as Probability
            };
            counts.iter().map(chance).collect()
        })
    }
}
