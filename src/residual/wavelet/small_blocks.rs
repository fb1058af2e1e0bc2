//! Small blocks: which parts of the render a picture is predicted from.
//!
//! Where a new object hides what the prior shows, the render's details would have to be taken away again. So each
//! block, of 8 or of 16 pixels, is predicted from the render with its details, or *plain*: from the render's coarsest
//! low band alone. The choice acts on wavelet coefficients, whose pictures overlap, and fades a little into the blocks
//! beside: no seam shows.

use super::adaptive_bit::{AdaptiveBit, Price};
use super::geometry::{Geometry, Orientation};
use crate::range_coder::{Bits, EVEN};

/// The weight of a coefficient that is predicted from the render's as it is.
pub const FULL: u8 = 16;
/// Levels whose cells are the blocks of the two grids: of 8 and of 16 pixels.
const LEVELS: [usize; GRIDS] = [3, 4];
/// Grids that there are.
pub const GRIDS: usize = 2;

/// Blocks of one size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Grid {
    /// The level of the transform whose cells they are.
    pub level: usize,
    pub columns: usize,
    pub rows: usize,
}

impl Grid {
    fn of(geometry: &Geometry, level: usize) -> Grid {
        let level = level.min(geometry.levels);
        let (columns, rows) = geometry.sizes[level];
        Grid { level, columns, rows }
    }

    /// Number of blocks.
    pub fn len(self) -> usize {
        self.columns * self.rows
    }

    /// The block that a coefficient of a level, no coarser than the grid's, lies in.
    pub fn block(self, level: usize, x: usize, y: usize) -> usize {
        let shift = self.level - level;
        (y >> shift).min(self.rows - 1) * self.columns + (x >> shift).min(self.columns - 1)
    }

    /// The blocks beside one: left, above, right, below.
    pub fn beside(self, at: usize) -> [Option<usize>; 4] {
        let (x, y) = (at % self.columns, at / self.columns);
        [
            (x > 0).then(|| at - 1),
            (y > 0).then(|| at - self.columns),
            (x + 1 < self.columns).then_some(at + 1),
            (y + 1 < self.rows).then_some(at + self.columns),
        ]
    }
}

/// The blocks of a frame.
pub struct SmallBlocks {
    /// Whether the frame has any that is plain. Else its payload says nothing of small blocks.
    pub in_use: bool,
    pub grids: [Grid; GRIDS],
    /// Which grid is used.
    pub grid: usize,
    /// Whether each block of the grid is plain, row by row.
    plain: Vec<bool>,
}

impl SmallBlocks {
    pub fn new(geometry: &Geometry) -> SmallBlocks {
        let grids = LEVELS.map(|level| Grid::of(geometry, level));
        SmallBlocks { in_use: false, grids, grid: 0, plain: vec![false; grids[0].len()] }
    }

    fn used(&self) -> Grid {
        self.grids[self.grid]
    }

    /// Takes the blocks of a grid.
    pub fn set(&mut self, grid: usize, plain: &[bool]) {
        self.grid = grid;
        self.plain[..plain.len()].copy_from_slice(plain);
    }

    /// Codes the grid and its blocks.
    pub fn code(&mut self, coder: &mut impl Bits) {
        self.grid = usize::from(coder.bit(EVEN, self.grid > 0));
        let mut chances = Chances::new();
        for at in 0..self.used().len() {
            let chance = chances.of(self.used(), |at| self.plain[at], at);
            self.plain[at] = chance.code(coder, self.plain[at]);
        }
    }

    /// Bits that they take.
    pub fn bits(&mut self) -> f64 {
        let mut price = Price::default();
        self.code(&mut price);
        price.0
    }

    /// Sets the weights of all detail coefficients, by their places in a transformed plane.
    pub fn weigh(&self, geometry: &Geometry, weights: &mut [u8]) {
        let grid = self.used();
        for band in geometry.bands().filter(|band| band.orientation != Orientation::Low) {
            for (y, row) in band.rows(geometry).enumerate() {
                if band.level > grid.level {
                    for (x, weight) in weights[row].iter_mut().enumerate() {
                        *weight = self.mean(band.level - grid.level, x, y);
                    }
                    continue;
                }
                let side = 1 << (grid.level - band.level);
                for (column, weights) in weights[row].chunks_mut(side).enumerate() {
                    weights.fill(self.weight(grid.block(band.level, column * side, y)));
                }
            }
        }
    }

    /// The weight in a block. Each block beside that is of the other kind moves it by a 32nd; it is rounded down.
    fn weight(&self, at: usize) -> u8 {
        let detailed = |at: usize| u8::from(!self.plain[at]);
        let beside = self.used().beside(at);
        let sum: u8 = beside.into_iter().map(|other| detailed(other.unwrap_or(at))).sum();
        (28 * detailed(at) + sum) / 2
    }

    /// The weight of a coefficient that covers several blocks: as many of them as are not plain.
    fn mean(&self, shift: usize, x: usize, y: usize) -> u8 {
        let Grid { columns, rows, .. } = self.used();
        let range = |at: usize, of: usize| (at << shift).min(of - 1)..((at + 1) << shift).min(of);
        let (mut all, mut detailed) = (0, 0);
        for row in range(y, rows) {
            for plain in &self.plain[row * columns..][range(x, columns)] {
                all += 1;
                detailed += usize::from(!plain);
            }
        }
        ((usize::from(FULL) * detailed + all / 2) / all) as u8
    }
}

/// The chance that a block is of a kind, by how many of those to its left and above are.
pub struct Chances([AdaptiveBit; 3]);

impl Chances {
    pub fn new() -> Chances {
        Chances([AdaptiveBit::new(1, 8), AdaptiveBit::new(2, 4), AdaptiveBit::new(7, 8)])
    }

    /// That of the block at a place. `is`: whether those before it are of the kind.
    pub fn of(&mut self, grid: Grid, is: impl Fn(usize) -> bool, at: usize) -> &mut AdaptiveBit {
        let [left, above, ..] = grid.beside(at);
        // At an edge the other one counts twice.
        let count = |block: Option<usize>| block.map_or(0, |block| usize::from(is(block)));
        &mut self.0[count(left.or(above)) + count(above.or(left))]
    }
}

/// What of a render's coefficient is not predicted.
pub fn left_out(render: i32, weight: u8) -> i32 {
    (render * i32::from(FULL - weight)) >> FULL.ilog2()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::range_coder::{RangeEncoder, WholeReader};

    fn blocks(size: (u32, u32), grid: usize, plain: &[bool]) -> (Geometry, SmallBlocks) {
        let geometry = Geometry::new(size.0, size.1);
        let mut blocks = SmallBlocks::new(&geometry);
        let len = blocks.grids[grid].len();
        blocks.set(grid, &plain.iter().copied().cycle().take(len).collect::<Vec<_>>());
        (geometry, blocks)
    }

    fn any_size() -> impl Strategy<Value = (u32, u32)> {
        (1_u32..80, 1_u32..80)
    }

    proptest! {
        #[test]
        fn blocks_come_back_at_their_price(
            size in any_size(),
            grid in 0..GRIDS,
            plain in proptest::collection::vec(any::<bool>(), 1..200),
        ) {
            let (geometry, mut blocks) = blocks(size, grid, &plain);
            let mut bytes = Vec::new();
            let mut encoder = RangeEncoder::new(&mut bytes, 1000);
            blocks.code(&mut encoder);
            prop_assert!(encoder.finish());
            prop_assert!(bytes.len() as f64 <= blocks.bits() / 8.0 + 2.0);
            let mut read = SmallBlocks::new(&geometry);
            read.code(&mut WholeReader::new(&bytes));
            let len = read.used().len();
            prop_assert_eq!(read.grid, grid);
            prop_assert_eq!(&read.plain[..len], &blocks.plain[..len]);
        }

        #[test]
        fn any_bytes_are_blocks_or_none(size in any_size(), bytes: Vec<u8>) {
            let geometry = Geometry::new(size.0, size.1);
            let mut blocks = SmallBlocks::new(&geometry);
            blocks.code(&mut WholeReader::new(&bytes));
            let mut weights = vec![FULL; geometry.len()];
            blocks.weigh(&geometry, &mut weights);
            prop_assert!(weights.iter().all(|weight| *weight <= FULL));
        }
    }

    #[test]
    fn weights_are_full_only_far_from_plain_blocks() {
        let (geometry, blocks) = blocks((128, 96), 1, &[false, true, false, false, false]);
        let mut weights = vec![FULL; geometry.len()];
        blocks.weigh(&geometry, &mut weights);
        let at = |level: usize, x: usize, y: usize| {
            let band = geometry.band(level, Orientation::Horizontal);
            weights[band.offset + y * geometry.width + x]
        };
        // The second block of the first row is plain, and the fourth of the second row.
        let row = [0, 1, 2, 3, 4].map(|x| at(4, x, 0));
        assert_eq!(row, [15, 1, 15, 15, 16]);
        // All coefficients of a block have its weight.
        assert_eq!((at(1, 8, 0), at(1, 15, 7), at(1, 16, 0), at(2, 4, 3)), (1, 1, 15, 1));
        // One block of four is plain.
        assert_eq!(at(5, 0, 0), 12);
        // Low bands have another choice.
        assert_eq!(weights[0], FULL);
    }

    #[test]
    fn what_is_left_out_is_all_or_nothing_or_a_part() {
        for render in [-70_000, -1, 0, 1, 33, 70_000] {
            assert_eq!((left_out(render, 0), left_out(render, FULL)), (render, 0));
        }
        assert_eq!((left_out(64, 12), left_out(-64, 12)), (16, -16));
    }
}
