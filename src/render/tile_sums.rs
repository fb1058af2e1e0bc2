//! The normal equations of a picture, tile by tile.

use crate::shared::{Params, SUMS};

/// The sums of the tiles of an evaluation: see [`NormalEquations::from_sums`](super::NormalEquations::from_sums).
#[derive(Clone, Copy)]
pub(crate) struct TileSums<'a> {
    /// [`SUMS`] of each tile that was drawn, row by row.
    pub sums: &'a [f32],
    /// Columns and rows of the whole picture, tiles.
    pub picture: [usize; 2],
    /// The first row that was drawn, and the distance of those that were.
    pub first_row: usize,
    pub row_step: usize,
}

impl<'a> TileSums<'a> {
    pub fn new(sums: &'a [f32], params: &Params) -> TileSums<'a> {
        TileSums {
            sums,
            picture: [params.tiles_x as usize, params.picture_rows() as usize],
            first_row: params.row_first as usize,
            row_step: 1 << (params.row_shift & 31),
        }
    }

    /// Column, row and sums of each tile that was drawn.
    pub fn iter(&self) -> impl Iterator<Item = (usize, usize, &'a [f32])> {
        let TileSums { sums, picture: [columns, _], first_row, row_step } = *self;
        sums.chunks_exact(SUMS as usize)
            .enumerate()
            .map(move |(tile, sums)| (tile % columns, first_row + tile / columns * row_step, sums))
    }
}
