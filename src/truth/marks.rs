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

/// Compares pictures of one size, in memory of its own: four bytes for each column and eight for each block.
pub(super) struct Comparison {
    size: [usize; 2],
    /// Sums of squared differences in each column, over the rows of a window.
    columns: Vec<u32>,
    /// The worst windows of each block, RMS: of the picture, and of the render.
    worst: [Vec<f32>; 2],
}

impl Comparison {
    pub fn new(width: u32, height: u32) -> Comparison {
        let blocks = Marks::new(width, height).marks.len();
        let size = [width, height].map(|side| side as usize);
        Comparison {
            size,
            columns: vec![0; size[0]],
            worst: [vec![0.0; blocks], vec![0.0; blocks]],
        }
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

    /// How many values a picture has.
    pub fn values(&self) -> usize {
        3 * self.size[0] * self.size[1]
    }

    /// The worst windows of each block between two pictures, RMS. Values of three colours, row by row.
    pub fn worst(&mut self, first: &[u8], second: &[u8]) -> &[f32] {
        self.compare(first, second, None, 0);
        &self.worst[0]
    }

    /// Finds the worst windows. Rows enter the sums and leave them one by one.
    fn compare(&mut self, frame: &[u8], shown: &[u8], mask: Option<&Mask>, which: usize) {
        let [width, height] = self.size;
        let block = BLOCK as usize;
        let down = block.min(height);
        let rows = Rows { pixels: [frame, shown], mask, width };
        let Comparison { columns: sums, worst, .. } = self;
        let worst = &mut worst[which];
        worst.fill(0.0);
        sums.fill(0);
        for y in 0..height {
            rows.each(y, sums, |sum, off| *sum += off);
            if y >= down {
                rows.each(y - down, sums, |sum, off| *sum -= off);
            }
            if y + 1 >= down {
                let top = y + 1 - down;
                let row = (top + down / 2) / block * width.div_ceil(block);
                worst_of_row(sums, down, &mut worst[row..]);
                if top.is_multiple_of(block) {
                    last_block(sums, down, &mut worst[row..]);
                }
            }
        }
        // Blocks at the lower edge that are smaller than a window.
        let last = height / block * block;
        if (1..height).contains(&last) {
            (height - down..last).for_each(|y| rows.each(y, sums, |sum, off| *sum -= off));
            let row = last / block * width.div_ceil(block);
            for (sums, worst) in sums.chunks(block).zip(&mut worst[row..]) {
                *worst = worst.max(rms(sums.iter().sum(), sums.len() * (height - last)));
            }
        }
    }
}

/// Two pictures row by row.
struct Rows<'a> {
    pixels: [&'a [u8]; 2],
    mask: Option<&'a Mask>,
    width: usize,
}

impl Rows<'_> {
    /// Gives `change` the sum and the squared difference of each pixel in a row that counts.
    fn each(&self, y: usize, sums: &mut [u32], change: impl Fn(&mut u32, u32)) {
        let row = y * self.width..(y + 1) * self.width;
        let [seen, shown] = self.pixels.map(|pixels| &pixels.as_chunks::<3>().0[row.clone()]);
        let mask = self.mask.map(|mask| &mask.data[row]);
        for (x, (sum, (seen, shown))) in sums.iter_mut().zip(seen.iter().zip(shown)).enumerate() {
            if mask.is_none_or(|mask| mask[x]) {
                let off = |c: usize| u32::from(seen[c].abs_diff(shown[c])).pow(2);
                change(sum, off(0) + off(1) + off(2));
            }
        }
    }
}

/// Finds the worst windows of a row of them, from the sums of their columns. `worst`: of the blocks that they lie in.
fn worst_of_row(columns: &[u32], down: usize, worst: &mut [f32]) {
    let block = BLOCK as usize;
    let across = block.min(columns.len());
    let mut note = |block: usize, sum| worst[block] = worst[block].max(rms(sum, across * down));
    let mut sum: u32 = columns[..across].iter().sum();
    let (mut index, mut greatest) = (0, sum);
    for left in 1..=columns.len() - across {
        sum = sum + columns[left + across - 1] - columns[left - 1];
        let next = (left + across / 2) / block;
        if next != index {
            note(index, greatest);
            (index, greatest) = (next, 0);
        }
        greatest = greatest.max(sum);
    }
    note(index, greatest);
}

/// The last block of a row of blocks, which may be smaller than a window.
fn last_block(columns: &[u32], down: usize, worst: &mut [f32]) {
    if let Some((index, columns)) = columns.chunks(BLOCK as usize).enumerate().next_back() {
        worst[index] = worst[index].max(rms(columns.iter().sum(), columns.len() * down));
    }
}

/// From a sum of squared differences of so many pixels.
fn rms(sum: u32, pixels: usize) -> f32 {
    (sum as f32 / (3 * pixels) as f32).sqrt()
}
