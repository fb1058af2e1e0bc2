//! Stages `bin_count`, `bin_scan`, `bin_emit`: (tile, splat) pairs in depth order. Splats come
//! sorted by depth, each block of [`BIN_BLOCK`] emits behind those before it, and the later sort by
//! tile is stable: so each tile's list ends up in depth order.

use crate::shared::{self, BIN_BLOCK, Counters, GROUP, Params, Projected};
use crate::scan::{saturating, scan};
use spirv_std::arch::workgroup_memory_barrier_with_group_sync as barrier;
use spirv_std::glam::{UVec3, Vec4};
use spirv_std::spirv;

const EACH: u32 = BIN_BLOCK / GROUP;

/// Tiles touched by the run of splats that an invocation owns, in depth order.
fn run_count(params: &Params, order: &[u32], tile_counts: &[u32], first: u32) -> u32 {
    let mut sum = 0;
    let mut k = 0;
    while k < EACH {
        if first + k < params.splats {
            sum += tile_counts[order[(first + k) as usize] as usize];
        }
        k += 1;
    }
    sum
}

/// Pairs of each block.
#[spirv(compute(threads(256)))]
pub fn bin_count(
    #[spirv(workgroup_id)] group: UVec3,
    #[spirv(local_invocation_index)] lane: u32,
    #[spirv(workgroup)] shared: &mut [u32; GROUP as usize],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] order: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] tile_counts: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] block_sums: &mut [u32],
) {
    let first = group.x * BIN_BLOCK + lane * EACH;
    let (_, total) = scan(run_count(params, order, tile_counts, first), lane, shared);
    if lane == 0 {
        block_sums[group.x as usize] = total;
    }
}

/// Where each block's pairs begin; the totals and the indirect dispatches that follow from them.
/// One workgroup.
#[spirv(compute(threads(256)))]
pub fn bin_scan(
    #[spirv(local_invocation_index)] lane: u32,
    #[spirv(workgroup)] shared: &mut [u32; GROUP as usize],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] block_sums: &mut [u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] counters: &mut Counters,
) {
    let blocks = params.splats.div_ceil(BIN_BLOCK);
    let mut before = 0;
    let mut first = 0;
    while first < blocks {
        let block = first + lane;
        let mut value = 0;
        if block < blocks {
            value = block_sums[block as usize];
        }
        let (prefix, total) = scan(value, lane, shared);
        if block < blocks {
            block_sums[block as usize] = saturating(before, prefix);
        }
        before = saturating(before, total);
        first += GROUP;
        barrier();
    }
    if lane == 0 {
        let mut pairs = before;
        if pairs > params.pair_capacity {
            pairs = params.pair_capacity;
        }
        counters.pairs_needed = before;
        counters.sort[0] = params.splats;
        counters.sort[1] = pairs;
        counters.radix_groups = [pairs.div_ceil(shared::RADIX_BLOCK), 1, 1];
        counters.pair_groups = [pairs.div_ceil(GROUP), 1, 1];
    }
}

/// What `project` wrote of a splat that binning needs.
fn load(records: &[Vec4], splat: u32) -> Projected {
    let at = (splat * shared::RECORD) as usize;
    let a = records[at];
    let b = records[at + 1];
    Projected {
        mean: [a.x, a.y],
        conic: [a.z, a.w, b.x],
        sigma: [b.z, b.w],
        opacity: b.y,
        depth: 0.0,
    }
}

/// Writes one splat's pairs from `next` on; never more than `count`, and pads to `count` with a tile
/// behind the last, should this stage's rounding find fewer tiles than `project`'s did.
fn emit(
    params: &Params,
    s: &Projected,
    splat: u32,
    mut next: u32,
    count: u32,
    tiles: &mut [u32],
    splats: &mut [u32],
) {
    let mut end = next + count;
    if end > params.pair_capacity {
        end = params.pair_capacity;
    }
    let [x0, y0, x1, y1] = shared::tile_box(params, s);
    let mut y = y0;
    while y < y1 {
        let mut x = x0;
        while x < x1 {
            let touched = shared::touches_tile(s.mean, s.conic, s.opacity, [x, y]);
            if touched & (next < end) {
                tiles[next as usize] = y * params.tiles_x + x;
                splats[next as usize] = splat;
                next += 1;
            }
            x += 1;
        }
        y += 1;
    }
    while next < end {
        tiles[next as usize] = params.tiles_x * params.tiles_y;
        splats[next as usize] = splat;
        next += 1;
    }
}

/// The pairs of each block, in depth order.
#[spirv(compute(threads(256)))]
pub fn bin_emit(
    #[spirv(workgroup_id)] group: UVec3,
    #[spirv(local_invocation_index)] lane: u32,
    #[spirv(workgroup)] shared: &mut [u32; GROUP as usize],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] order: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] tile_counts: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] block_sums: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] records: &[Vec4],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] pair_tiles: &mut [u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 6)] pair_splats: &mut [u32],
) {
    let first = group.x * BIN_BLOCK + lane * EACH;
    let (prefix, _) = scan(run_count(params, order, tile_counts, first), lane, shared);
    let mut next = block_sums[group.x as usize] + prefix;
    let mut k = 0;
    while k < EACH {
        if first + k < params.splats {
            let splat = order[(first + k) as usize];
            let count = tile_counts[splat as usize];
            if count > 0 {
                let s = load(records, splat);
                emit(params, &s, splat, next, count, pair_tiles, pair_splats);
                next += count;
            }
        }
        k += 1;
    }
}
