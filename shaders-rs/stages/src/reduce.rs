//! Stage `reduce`: sums of the normal equations, over a workgroup and over tiles, in a fixed order.

use crate::shared::{Params, SPLAT_THREADS, SUMS};
use spirv_std::arch::workgroup_memory_barrier_with_group_sync as barrier;
use spirv_std::glam::Vec3;
use spirv_std::spirv;

/// Shared memory that [`Sums::store`] needs.
pub type Scratch = [f32; (SUMS * SPLAT_THREADS) as usize];

/// The normal equations of some pixels: JᵀJ in 3×3 blocks (ρρ, ρθ, θθ), Jᵀr, r².
#[derive(Clone, Copy)]
pub struct Sums {
    /// Rows of the ρρ block.
    pub rr: [Vec3; 3],
    /// Rows of the ρθ block.
    pub rt: [Vec3; 3],
    /// Rows of the θθ block.
    pub tt: [Vec3; 3],
    pub gradient: [Vec3; 2],
    pub square: f32,
}

impl Sums {
    pub const ZERO: Sums = Sums {
        rr: [Vec3::ZERO; 3],
        rt: [Vec3::ZERO; 3],
        tt: [Vec3::ZERO; 3],
        gradient: [Vec3::ZERO; 2],
        square: 0.0,
    };

    /// Adds one channel of one pixel: its derivative with respect to ρ and θ, and its residual.
    pub fn add(self, rho: Vec3, theta: Vec3, residual: f32) -> Sums {
        Sums {
            rr: [self.rr[0] + rho * rho.x, self.rr[1] + rho * rho.y, self.rr[2] + rho * rho.z],
            rt: [
                self.rt[0] + theta * rho.x,
                self.rt[1] + theta * rho.y,
                self.rt[2] + theta * rho.z,
            ],
            tt: [
                self.tt[0] + theta * theta.x,
                self.tt[1] + theta * theta.y,
                self.tt[2] + theta * theta.z,
            ],
            gradient: [self.gradient[0] + rho * residual, self.gradient[1] + theta * residual],
            square: self.square + residual * residual,
        }
    }

    /// In the order of `partials`: the upper triangle of JᵀJ row by row, Jᵀr, r².
    #[rustfmt::skip]
    fn values(&self) -> [f32; SUMS as usize] {
        let (rr, rt, tt) = (&self.rr, &self.rt, &self.tt);
        let [rho, theta] = &self.gradient;
        [
            rr[0].x, rr[0].y, rr[0].z, rt[0].x, rt[0].y, rt[0].z,
            rr[1].y, rr[1].z, rt[1].x, rt[1].y, rt[1].z,
            rr[2].z, rt[2].x, rt[2].y, rt[2].z,
            tt[0].x, tt[0].y, tt[0].z,
            tt[1].y, tt[1].z,
            tt[2].z,
            rho.x, rho.y, rho.z, theta.x, theta.y, theta.z,
            self.square,
        ]
    }

    /// Sums over the tile's invocations and writes the tile's row of `partials`.
    pub fn store(&self, lane: u32, tile: u32, scratch: &mut Scratch, partials: &mut [f32]) {
        let values = self.values();
        let mut k = 0;
        while k < SUMS as usize {
            scratch[(lane * SUMS) as usize + k] = values[k];
            k += 1;
        }
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
        while tile < tiles {
            sum += partials[(tile * SUMS + k) as usize];
            tile += LANES;
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
