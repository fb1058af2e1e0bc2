//! Stages `bin_count`, `bin_scan`, `bin_emit`: each tile's splats in depth order.

use crate::Camera;
use crate::shared::{self, TILE, band_rows};
use crate::vulkan::{Error, Recorder};

use super::Kernels;
use super::view::View;
use super::workspace::Workspace;

/// Most counters of the table of blocks by tiles.
const TABLE: u32 = 1 << 20;
/// Most tiles of a picture.
const TILES: u32 = (Camera::MAX_SIDE / TILE).pow(2);
/// Words of the table, with the row that says where lists end.
pub(crate) const STARTS: u32 = TABLE + TILES;
/// Most bands of a picture: none has fewer rows of tiles than one as wide as a picture can be.
pub(crate) const BANDS: u32 = TILES / shared::TABLE;

const _: () = assert!(TABLE >= 4 * TILES, "blocks come by fours");

/// Logarithm, base 2, of the number of blocks for a picture of so many tiles.
pub(crate) fn log_blocks(most: u32, tiles: u32) -> u32 {
    (TABLE / tiles.max(1)).max(1).ilog2().min(most)
}

pub(crate) fn record(
    recorder: &mut Recorder,
    kernels: &Kernels,
    view: &View,
    work: &Workspace,
) -> Result<(), Error> {
    let log_blocks = log_blocks(work.log_blocks, view.tile_count());
    let rows = band_rows(view.tiles[0]);
    let split = [log_blocks, rows];
    let groups = [1 << log_blocks, view.tiles[1].div_ceil(rows), 1];
    let (params, counters, starts) = (&view.params, &work.counters, &work.tile_starts);
    let (order, records, bands) = (&work.order, &work.records, &work.bands);
    let buffers = [params, counters, order, records, starts];
    recorder.dispatch(&kernels.bin_count, &buffers, &split, groups)?;
    let buffers = [params, starts, bands];
    recorder.dispatch(&kernels.bin_scan, &buffers, &split, [groups[1], 1, 1])?;
    let (ranges, pairs) = (&view.ranges, &work.pair_splats);
    let buffers = [params, counters, order, records, starts, bands, ranges, pairs];
    recorder.dispatch(&kernels.bin_emit, &buffers, &split, groups)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_stay_bounded() {
        for width in [8, 72, 1_024, Camera::MAX_SIDE] {
            let bands = (Camera::MAX_SIDE / TILE).div_ceil(band_rows(width / TILE));
            assert!(bands <= BANDS, "{width}: {bands} bands");
        }
        assert_eq!(log_blocks(4, 920), 4);
        assert_eq!(log_blocks(7, 14_400), 6);
        assert_eq!(log_blocks(7, TILES), 2);
    }
}
