//! Comparing pictures, and what is marked of each block.

use crate::Picture;
use crate::image::Mask;

use super::BLOCK;

/// What a map says of a block to the topside. In order: a map may say more of a block than what is true, never less.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Mark {
    /// The render alone shows it.
    #[default]
    Rendered = 0,
    /// It is as seen, thanks to the difference picture.
    Mended = 1,
    /// It differs.
    Differs = 2,
    /// It is wrong.
    Wrong = 3,
}

impl Mark {
    pub(super) fn is_off(self) -> bool {
        self >= Mark::Differs
    }
}

/// Share of the first threshold up to which a render counts as showing a block.
pub(super) const RENDERED: f32 = 0.8;

/// Marks of the blocks of a picture.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Marks {
    pub columns: usize,
    pub rows: usize,
    /// Row by row.
    pub marks: Vec<Mark>,
}

impl Marks {
    /// For pictures of a size, all marked as shown by the render.
    pub fn new(width: u32, height: u32) -> Marks {
        let [columns, rows] = [width, height].map(|side| side.div_ceil(BLOCK) as usize);
        Marks { columns, rows, marks: vec![Mark::default(); columns * rows] }
    }

    /// The mark of a block; beyond the edges as the render shows it.
    pub(super) fn at(&self, column: isize, row: isize) -> Mark {
        let inside = |at: isize, end: usize| usize::try_from(at).ok().filter(|at| *at < end);
        match (inside(column, self.columns), inside(row, self.rows)) {
            (Some(column), Some(row)) => self.marks[row * self.columns + column],
            _ => Mark::Rendered,
        }
    }

    /// Becomes the cells of `side` blocks a side of other marks: a cell has the highest of its blocks' marks. Has room
    /// for them.
    pub(super) fn set_cells_of(&mut self, blocks: &Marks, side: usize) {
        (self.columns, self.rows) = (blocks.columns.div_ceil(side), blocks.rows.div_ceil(side));
        self.marks.clear();
        self.marks.resize(self.columns * self.rows, Mark::Rendered);
        for (row, marks) in blocks.marks.chunks_exact(blocks.columns).enumerate() {
            let cells = &mut self.marks[row / side * self.columns..];
            for (column, mark) in marks.iter().enumerate() {
                let cell = &mut cells[column / side];
                *cell = (*cell).max(*mark);
            }
        }
    }

    /// Gives each block the mark of its cell, of `side` blocks a side.
    pub(super) fn set_blocks_of(&mut self, cells: &Marks, side: usize) {
        for (row, marks) in self.marks.chunks_exact_mut(self.columns).enumerate() {
            let cells = &cells.marks[row / side * cells.columns..];
            for (column, mark) in marks.iter_mut().enumerate() {
                *mark = cells[column / side];
            }
        }
    }
}

/// Compares pictures of one size, in memory of its own.
pub(super) struct Comparison {
    size: [usize; 2],
    /// Sums of squared differences over all pixels above and left, modulo 2³²: a window's sum is less.
    sums: Vec<u32>,
    /// The worst windows of each block, RMS: of the picture, and of the render.
    worst: [Vec<f32>; 2],
}

impl Comparison {
    pub fn new(width: u32, height: u32) -> Comparison {
        let blocks = Marks::new(width, height).marks.len();
        let size = [width, height].map(|side| side as usize);
        let sums = vec![0; (size[0] + 1) * (size[1] + 1)];
        Comparison { size, sums, worst: [vec![0.0; blocks], vec![0.0; blocks]] }
    }

    /// Marks what the topside's picture and the render show of a frame.
    pub fn mark(
        &mut self,
        frame: &Picture,
        [picture, render]: [&Picture; 2],
        mask: Option<&Mask>,
        thresholds: [f32; 2],
        marks: &mut Marks,
    ) {
        self.compare(&frame.data, &picture.data, mask, 0);
        self.compare(&frame.data, &render.data, mask, 1);
        let [first, second] = thresholds;
        let [picture, render] = &self.worst;
        for (mark, (picture, render)) in marks.marks.iter_mut().zip(picture.iter().zip(render)) {
            *mark = match () {
                () if *picture > second => Mark::Wrong,
                () if *picture > first => Mark::Differs,
                () if *render > RENDERED * first => Mark::Mended,
                () => Mark::Rendered,
            };
        }
    }

    /// The worst windows of each block between two pictures, RMS. Values of three colours, row by row.
    pub fn worst(&mut self, first: &[u8], second: &[u8]) -> &[f32] {
        self.compare(first, second, None, 0);
        &self.worst[0]
    }

    /// Finds the worst windows.
    fn compare(&mut self, frame: &[u8], shown: &[u8], mask: Option<&Mask>, which: usize) {
        self.sum_up(frame, shown, mask);
        let [width, height] = self.size;
        let block = BLOCK as usize;
        let columns = width.div_ceil(block);
        let Comparison { sums, worst, .. } = self;
        let worst = &mut worst[which];
        worst.fill(0.0);
        let stride = width + 1;
        let rms = |[left, top, right, bottom]: [usize; 4]| {
            let corners = sums[bottom * stride + right].wrapping_add(sums[top * stride + left]);
            let others = sums[top * stride + right].wrapping_add(sums[bottom * stride + left]);
            let sum = corners.wrapping_sub(others);
            (sum as f32 / (3 * (right - left) * (bottom - top)) as f32).sqrt()
        };
        let (across, down) = (block.min(width), block.min(height));
        for top in 0..=height - down {
            let row = (top + down / 2) / block * columns;
            for left in 0..=width - across {
                let index = row + (left + across / 2) / block;
                worst[index] = worst[index].max(rms([left, top, left + across, top + down]));
            }
        }
        // Blocks at the edges that are smaller than a window.
        for (index, worst) in worst.iter_mut().enumerate() {
            let (left, top) = (index % columns * block, index / columns * block);
            let (right, bottom) = ((left + block).min(width), (top + block).min(height));
            *worst = worst.max(rms([left, top, right, bottom]));
        }
    }

    fn sum_up(&mut self, frame: &[u8], shown: &[u8], mask: Option<&Mask>) {
        let width = self.size[0];
        let stride = width + 1;
        let rows = frame.chunks_exact(3 * width).zip(shown.chunks_exact(3 * width));
        for (y, (seen, shown)) in rows.enumerate() {
            let (before, after) = self.sums.split_at_mut((y + 1) * stride);
            let above = &before[y * stride..];
            let mut sum = 0_u32;
            let pixels = seen.as_chunks::<3>().0.iter().zip(shown.as_chunks::<3>().0);
            for (x, (seen, shown)) in pixels.enumerate() {
                if mask.is_none_or(|mask| mask.data[y * width + x]) {
                    let off = |c: usize| u32::from(seen[c].abs_diff(shown[c])).pow(2);
                    sum = sum.wrapping_add(off(0) + off(1) + off(2));
                }
                after[x + 1] = above[x + 1].wrapping_add(sum);
            }
        }
    }
}
