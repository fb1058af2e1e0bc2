//! How binning is shared among workgroups, and the buffers that it takes.

use crate::Camera;
use crate::shared::{self, Params, TILE};
use crate::vulkan::{Buffer, Device, Error, Memory};

use super::kernels;

/// Most counters in the table of blocks by tiles: 16 MiB. A picture takes only what it needs.
const TABLE: u32 = 1 << 22;
/// Most tiles of a picture.
const TILES: u32 = (Camera::MAX_SIDE / TILE).pow(2);
/// Most bands of a picture: the number in the widest picture, whose bands have the fewest rows of tiles.
pub const BANDS: u32 = TILES / shared::BIN_TABLE;

const _: () = assert!(TABLE >= 4 * TILES, "blocks come by fours");
const _: () = assert!(shared::BIN_TABLE >= Camera::MAX_SIDE / TILE, "a band has at least one row");

/// How binning is shared among workgroups.
pub struct Binning {
    /// Logarithm, base 2, of their number for each band.
    pub log_blocks: u32,
    /// Counters of each: tiles of a band at most.
    table: u32,
    /// Rows of tiles of a band at most.
    most_rows: u32,
    /// Where each block's part of each tile's list begins. The last row holds the ends.
    pub starts: Buffer,
}

impl Binning {
    /// Makes buffers for pictures of at most `tiles` tiles.
    pub fn new(device: &Device, log_blocks: u32, tiles: u32) -> Result<Binning, Error> {
        let table = kernels::bin_table(device.info());
        let most_rows = kernels::band_rows(device.info());
        let words = (u64::from(tiles) << log_blocks) + u64::from(tiles);
        let starts = Buffer::new::<u32>(device, "tile starts", words as usize, Memory::Device)?;
        Ok(Binning { log_blocks, table, most_rows, starts })
    }

    /// Shares the binning of these parameters' picture.
    pub fn share(&self, params: &mut Params) {
        params.bin_blocks = 1 << self.log_blocks;
        params.band_rows =
            band_rows(self.table, params.tiles_x, self.log_blocks).min(self.most_rows);
    }
}

/// Rows of tiles of a band. Stage `bin_scan` goes through the counters of a band's blocks in a loop, and llvmpipe ends
/// loops after 65,535 rounds.
fn band_rows(table: u32, tiles_x: u32, log_blocks: u32) -> u32 {
    (table.min((1 << 19) >> log_blocks) / tiles_x).max(1)
}

/// Logarithm, base 2, of the number of blocks for a picture of `tiles` tiles.
pub fn log_blocks(most: u32, tiles: u32) -> u32 {
    (TABLE / tiles.max(1)).max(1).ilog2().min(most)
}

/// Logarithm, base 2, of the most blocks for a picture of `tiles` tiles. Stage `bin_scan` goes through the table in a
/// loop, and llvmpipe ends loops after 65,535 rounds.
pub fn log_most_blocks(tiles: u32) -> u32 {
    (TABLE / 4 / tiles.max(1)).max(4).ilog2().min(14)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_stay_bounded() {
        for width in [8, 72, 1_024, Camera::MAX_SIDE] {
            for log_blocks in 2..=8 {
                let rows = band_rows(shared::BIN_TABLE, width / TILE, log_blocks);
                let bands = (Camera::MAX_SIDE / TILE).div_ceil(rows);
                assert!(bands <= BANDS, "{width}, {log_blocks}: {bands} bands");
            }
        }
        assert_eq!(band_rows(shared::LOCKSTEP_TABLE, 160, 4), 51);
        assert_eq!(band_rows(shared::LOCKSTEP_TABLE, 160, 8), 12);
        assert_eq!(log_blocks(4, 920), 4);
        assert_eq!(log_blocks(8, 14_400), 8);
        assert_eq!(log_blocks(7, TILES), 4);
        for tiles in [1, 920, 14_400, TILES] {
            let rounds = (u64::from(tiles) << log_most_blocks(tiles)) / 32;
            assert!(rounds < 65_535, "{tiles} tiles: {rounds} rounds");
            assert!(log_most_blocks(tiles) >= 2, "blocks come by fours");
        }
    }
}
