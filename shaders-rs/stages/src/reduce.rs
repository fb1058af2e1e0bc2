//! Stage `reduce`: sums of the normal equations, over a workgroup and over tiles, in a fixed order.

use crate::memory::{at, at_mut};
use crate::rows::Rows;
use crate::shared::{Params, SPLAT_THREADS, SUMS};
use spirv_std::arch::{subgroup_f_add, workgroup_memory_barrier_with_group_sync as barrier};
use spirv_std::spirv;

/// Shared memory that [`store`] needs.
pub type Scratch = [f32; (SUMS * SPLAT_THREADS) as usize];

/// One channel of some pixels: its derivative with respect to the pose, ρ then θ, and its residual.
pub type Channel<R> = [R; 7];

/// The three channels of some pixels.
pub type Channels<R> = [Channel<R>; 3];

/// The product of two columns of a channel, summed over channels and pixels.
fn product<R: Rows>(of: &Channels<R>, i: usize, j: usize) -> f32 {
    (of[0][i] * of[0][j] + of[1][i] * of[1][j] + of[2][i] * of[2][j]).sum()
}

/// Calls a macro with each sum's index and its two columns, in the order of `partials`: the upper triangle of JᵀJ row
/// by row, Jᵀr, r².
macro_rules! for_each_sum {
    ($call:ident) => {
        $call!(0, 0, 0);
        $call!(1, 0, 1);
        $call!(2, 0, 2);
        $call!(3, 0, 3);
        $call!(4, 0, 4);
        $call!(5, 0, 5);
        $call!(6, 1, 1);
        $call!(7, 1, 2);
        $call!(8, 1, 3);
        $call!(9, 1, 4);
        $call!(10, 1, 5);
        $call!(11, 2, 2);
        $call!(12, 2, 3);
        $call!(13, 2, 4);
        $call!(14, 2, 5);
        $call!(15, 3, 3);
        $call!(16, 3, 4);
        $call!(17, 3, 5);
        $call!(18, 4, 4);
        $call!(19, 4, 5);
        $call!(20, 5, 5);
        $call!(21, 0, 6);
        $call!(22, 1, 6);
        $call!(23, 2, 6);
        $call!(24, 3, 6);
        $call!(25, 4, 6);
        $call!(26, 5, 6);
        $call!(27, 6, 6);
    };
}

/// Sums over the tile's invocations and writes the tile's row of `partials`.
pub fn store<R: Rows>(
    of: &Channels<R>,
    lane: u32,
    tile: u32,
    scratch: &mut Scratch,
    partials: &mut [f32],
) {
    macro_rules! publish {
        ($k:literal, $i:literal, $j:literal) => {
            scratch[(lane * SUMS + $k) as usize] = product(of, $i, $j);
        };
    }
    for_each_sum!(publish);
    barrier();
    let mut k = lane;
    while k < SUMS {
        let mut sum = 0.0;
        let mut other = 0;
        while other < SPLAT_THREADS {
            sum += scratch[(other * SUMS + k) as usize];
            other += 1;
        }
        partials[(tile * SUMS + k) as usize] = sum;
        k += SPLAT_THREADS;
    }
}

/// Sums over a subgroup, which has one tile, and writes the tile's row of `partials`. One sum after another, as all at
/// once would take many registers.
pub fn store_of_subgroup<R: Rows, const SUBGROUP: u32>(
    of: &Channels<R>,
    lane: u32,
    tile: u32,
    partials: &mut [f32],
) {
    // Invocation k keeps sum k; the second one is for subgroups of 16.
    let mut own = [0.0, 0.0];
    macro_rules! keep {
        ($k:literal, $i:literal, $j:literal) => {
            let sum = subgroup_f_add(product(of, $i, $j));
            own[$k / SUBGROUP as usize % 2] =
                if lane == $k % SUBGROUP { sum } else { own[$k / SUBGROUP as usize % 2] };
        };
    }
    for_each_sum!(keep);
    let first = tile * SUMS + lane;
    if lane < SUMS {
        *at_mut(partials, first) = own[0];
    }
    if lane + SUBGROUP < SUMS {
        *at_mut(partials, first + SUBGROUP) = own[1];
    }
}

const LANES: u32 = 8;
const COLUMNS: u32 = 32;

/// Shared memory that [`total`] needs.
pub type Columns = [f32; (LANES * COLUMNS) as usize];

/// Sums the tiles' rows; `scratch` then begins with the totals. For a whole workgroup of 256: eight
/// invocations per sum, then one adds the eight.
pub fn total(lane: u32, tiles: u32, partials: &[f32], scratch: &mut Columns) {
    let k = lane % COLUMNS;
    let mut sum = 0.0;
    if k < SUMS {
        let mut tile = lane / COLUMNS;
        macro_rules! load {
            // Beyond the last tile the last one is loaded, and not added.
            ($j:literal) => {
                at(partials, (tile + $j * LANES).min(tiles - 1) * SUMS + k)
            };
        }
        macro_rules! add {
            ($j:literal, $value:ident) => {
                sum += if tile + $j * LANES < tiles { $value } else { 0.0 };
            };
        }
        // Eight tiles are loaded at once: one after the other, a GPU would wait for each.
        while tile < tiles {
            let (a, b, c, d) = (load!(0), load!(1), load!(2), load!(3));
            let (e, f, g, h) = (load!(4), load!(5), load!(6), load!(7));
            add!(0, a);
            add!(1, b);
            add!(2, c);
            add!(3, d);
            add!(4, e);
            add!(5, f);
            add!(6, g);
            add!(7, h);
            tile += 8 * LANES;
        }
    }
    scratch[lane as usize] = sum;
    barrier();
    let mut total = 0.0;
    if lane < SUMS {
        let mut part = 0;
        while part < LANES {
            total += scratch[(part * COLUMNS + lane) as usize];
            part += 1;
        }
    }
    barrier();
    if lane < SUMS {
        scratch[lane as usize] = total;
    }
    barrier();
}

/// Sums the tiles' rows. One workgroup.
#[spirv(compute(threads(256)))]
pub fn reduce(
    #[spirv(local_invocation_index)] lane: u32,
    #[spirv(workgroup)] scratch: &mut Columns,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] partials: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] sums: &mut [f32],
) {
    total(lane, params.tiles_x * params.tiles_y, partials, scratch);
    if lane < SUMS {
        sums[lane as usize] = scratch[lane as usize];
    }
}
