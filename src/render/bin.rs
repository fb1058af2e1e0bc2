//! Stages `bin_count`, `bin_scan`, `bin_emit`: each tile's splats in depth order.

use std::mem::offset_of;

use crate::Camera;
use crate::shared::{self, Groups, TILE};
use crate::vulkan::{Error, Recorder};

use super::Kernels;
use super::view::{Part, View};
use super::workspace::Workspace;

/// Most counters of the table of blocks by tiles: 16 MiB, of which a picture takes what it needs.
const TABLE: u32 = 1 << 22;
/// Most tiles of a picture.
const TILES: u32 = (Camera::MAX_SIDE / TILE).pow(2);
/// Most bands of a picture: none has fewer rows of tiles than one as wide as a picture can be.
pub(crate) const BANDS: u32 = TILES / shared::TABLE;

const _: () = assert!(TABLE >= 4 * TILES, "blocks come by fours");
const _: () = assert!(shared::TABLE >= Camera::MAX_SIDE / TILE, "a band has a row and more");

/// Words of the table of a picture, with the row that says where lists end.
pub(crate) fn starts(log_blocks: u32, tiles: u32) -> usize {
    ((tiles << log_blocks) + tiles) as usize
}

/// Logarithm, base 2, of the number of blocks for a picture of so many tiles.
pub(crate) fn log_blocks(most: u32, tiles: u32) -> u32 {
    (TABLE / tiles.max(1)).max(1).ilog2().min(most)
}

pub(crate) fn record(
    recorder: &mut Recorder,
    kernels: &Kernels,
    view: &View,
    work: &Workspace,
    part: Part,
) -> Result<(), Error> {
    let split = [view.log_bin_blocks];
    let blocks = part.at(offset_of!(Groups, bin_blocks));
    let bands_at = part.at(offset_of!(Groups, bands));
    let (r, groups) = (recorder, &view.groups);
    let (params, counters, starts) = (&view.params, &work.counters, &view.tile_starts);
    let (order, records, bands) = (&work.order, &work.records, &view.bands);
    let buffers = [params, counters, order, records, starts];
    r.dispatch_indirect(&kernels.bin_count, &buffers, &split, groups, blocks)?;
    let buffers = [params, starts, bands];
    r.dispatch_indirect(&kernels.bin_scan, &buffers, &split, groups, bands_at)?;
    let (ranges, pairs) = (&view.ranges, &work.pair_splats);
    let buffers = [params, counters, order, records, starts, bands, ranges, pairs];
    r.dispatch_indirect(&kernels.bin_emit, &buffers, &split, groups, blocks)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::band_rows;

    #[test]
    fn tables_stay_bounded() {
        for width in [8, 72, 1_024, Camera::MAX_SIDE] {
            let bands = (Camera::MAX_SIDE / TILE).div_ceil(band_rows(width / TILE));
            assert!(bands <= BANDS, "{width}: {bands} bands");
        }
        assert_eq!(log_blocks(4, 920), 4);
        assert_eq!(log_blocks(8, 14_400), 8);
        assert_eq!(log_blocks(7, TILES), 4);
        assert_eq!(starts(4, 920), 17 * 920);
    }
}
