//! Stages `bin_count`, `bin_scan`, `bin_emit`: each tile's splats in depth order.

use crate::shared::band_rows;
use crate::vulkan::{Error, Recorder};

use super::Kernels;
use super::view::View;
use super::workspace::Workspace;

/// Most counters of the table of blocks by tiles.
const TABLE: u32 = 1 << 20;

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
    let log_blocks = log_blocks(kernels.log_blocks, view.tile_count());
    let rows = band_rows(view.tiles[0]);
    let split = [log_blocks, rows];
    let groups = [1 << log_blocks, view.tiles[1].div_ceil(rows), 1];
    let (params, counters, starts) = (&view.params, &work.counters, &view.tile_starts);
    let buffers = [params, counters, &work.order, &work.records, starts];
    recorder.dispatch(&kernels.bin_count, &buffers, &split, groups)?;
    let buffers = [params, counters, starts, &view.ranges];
    recorder.dispatch(&kernels.bin_scan, &buffers, &split, [1, 1, 1])?;
    let buffers = [params, counters, &work.order, &work.records, starts, &work.pair_splats];
    recorder.dispatch(&kernels.bin_emit, &buffers, &split, groups)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Camera;
    use crate::shared::TILE;

    #[test]
    fn tables_stay_bounded() {
        assert_eq!(log_blocks(4, 920), 4);
        assert_eq!(log_blocks(7, 14_400), 6);
        assert_eq!(log_blocks(7, (Camera::MAX_SIDE / TILE).pow(2)), 2);
        assert_eq!(log_blocks(7, u32::MAX), 0);
    }
}
