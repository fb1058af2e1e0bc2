//! Stage `ranges`: where each tile's pairs begin and end. The buffer comes cleared, so a tile without
//! pairs keeps an empty range.

use crate::shared::{Counters, Params};
use spirv_std::glam::{UVec2, UVec3};
use spirv_std::spirv;

/// One invocation a pair, over pairs sorted by tile.
#[spirv(compute(threads(256)))]
pub fn ranges(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] counters: &Counters,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] pair_tiles: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] ranges: &mut [UVec2],
) {
    let count = counters.sort[1];
    if id.x >= count {
        return;
    }
    let tiles = params.tiles_x * params.tiles_y;
    let tile = pair_tiles[id.x as usize];
    // Tiles behind the last mark padding.
    if tile >= tiles {
        return;
    }
    if (id.x == 0) || (pair_tiles[id.x as usize - 1] != tile) {
        ranges[tile as usize].x = id.x;
    }
    if (id.x + 1 == count) || (pair_tiles[id.x as usize + 1] != tile) {
        ranges[tile as usize].y = id.x + 1;
    }
}
