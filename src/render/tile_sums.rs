//! The normal equations of a picture, tile by tile.

use crate::shared::{Params, SUMS};

/// The sums of the tiles of an evaluation: see [`NormalEquations::from_sums`](super::NormalEquations::from_sums).
#[derive(Clone, Copy)]
pub(crate) struct TileSums<'a> {
    /// [`SUMS`] of each tile that was drawn, row by row.
    pub sums: &'a [f32],
    /// Which tiles these are.
    pub params: Params,
}

impl<'a> TileSums<'a> {
    /// Columns and rows of the whole picture, tiles.
    pub fn picture(&self) -> [usize; 2] {
        [self.params.tiles_x as usize, self.params.picture_rows() as usize]
    }

    /// Column, row and sums of each tile that was drawn.
    pub fn iter(&self) -> impl Iterator<Item = (usize, usize, &'a [f32])> {
        let TileSums { sums, params } = *self;
        let columns = params.tiles_x as usize;
        sums.chunks_exact(SUMS as usize).enumerate().map(move |(tile, sums)| {
            (tile % columns, params.tile_row((tile / columns) as u32) as usize, sums)
        })
    }
}
