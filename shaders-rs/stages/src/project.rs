//! Stage `project`: each splat's mean, conic, colour and depth as the camera sees it, and its key for
//! the sort by depth.

use crate::memory::{Pairs, at_mut};
use crate::shared::{self, Counters, Params};
use spirv_std::arch::{atomic_load, atomic_u_max};
use spirv_std::glam::{UVec3, Vec4};
use spirv_std::memory::{Scope, Semantics};
use spirv_std::spirv;

/// Position, opacity and the scaled axes turned into camera coordinates.
pub struct Splat {
    pub world: [f32; 3],
    pub camera: [f32; 3],
    pub opacity: f32,
    pub axes: [[f32; 3]; 3],
}

/// The pair of splat `i`, of `splats`, in a plane. (A closure would hold the buffer in a structure, which crashes
/// SwiftShader.)
fn of_plane<B: Pairs + ?Sized>(planes: &B, plane: u32, splats: u32, i: u32) -> [f32; 2] {
    // The host allocated these planes, with this many splats each.
    planes.pair(plane * splats + i)
}

/// Reads splat `i` from its planes.
pub fn load<B: Pairs + ?Sized>(params: &Params, geometry: &B, i: u32) -> Splat {
    let n = params.splats;
    let [x, y] = of_plane(geometry, 0, n, i);
    let [z, opacity] = of_plane(geometry, 1, n, i);
    let [a, b] = of_plane(geometry, 2, n, i);
    let [c, d] = of_plane(geometry, 3, n, i);
    let [e, f] = of_plane(geometry, 4, n, i);
    let [g, h] = of_plane(geometry, 5, n, i);
    let [k, _] = of_plane(geometry, 6, n, i);
    let world = [x, y, z];
    let turned = shared::transform(&params.rotation, world);
    let camera = [
        turned[0] + params.translation[0],
        turned[1] + params.translation[1],
        turned[2] + params.translation[2],
    ];
    let axes = [
        shared::transform(&params.rotation, [a, b, c]),
        shared::transform(&params.rotation, [d, e, f]),
        shared::transform(&params.rotation, [g, h, k]),
    ];
    Splat { world, camera, opacity, axes }
}

/// Coefficients `2 two` and `2 two + 1` of splat `i`; 0 after the last.
pub fn coefficients<B: Pairs + ?Sized>(params: &Params, sh: &B, two: u32, i: u32) -> [[f32; 3]; 2] {
    let (n, first) = (params.splats, 3 * two);
    let [a, b] = of_plane(sh, first, n, i);
    let [c, d] = of_plane(sh, first + 1, n, i);
    let [e, f] = of_plane(sh, first + 2, n, i);
    [[a, b, c], [d, e, f]]
}

/// Colour from spherical harmonics, + 0.5, by [`shared::shown`].
fn colour<B: Pairs + ?Sized>(
    params: &Params,
    sh_degree: u32,
    sh: &B,
    i: u32,
    world: [f32; 3],
) -> [f32; 3] {
    let (d, _) = shared::direction(params, world);
    let basis = shared::sh_basis(d);
    let mut rgb = [0.5, 0.5, 0.5];
    let count = shared::sh_coefficients(sh_degree);
    let mut two = 0;
    while 2 * two < count {
        let [one, other] = coefficients(params, sh, two, i);
        let (b, c) = (basis[2 * two as usize], basis[2 * two as usize + 1]);
        rgb = [rgb[0] + b * one[0], rgb[1] + b * one[1], rgb[2] + b * one[2]];
        rgb = [rgb[0] + c * other[0], rgb[1] + c * other[1], rgb[2] + c * other[2]];
        two += 1;
    }
    [shared::shown(rgb[0]), shared::shown(rgb[1]), shared::shown(rgb[2])]
}

/// Takes note of a key. Most keys are not the largest so far and cost only a read.
fn note(largest: &mut u32, key: u32) {
    // SAFETY: atomics on a word of a storage buffer; the largest of integers is the same in any
    // order.
    unsafe {
        const SCOPE: u32 = Scope::QueueFamily as u32;
        const RELAXED: u32 = Semantics::NONE.bits();
        if atomic_load::<u32, SCOPE, RELAXED>(largest) < key {
            atomic_u_max::<u32, SCOPE, RELAXED>(largest, key);
        }
    }
}

fn run<B: Pairs + ?Sized>(
    id: u32,
    params: &Params,
    sh_degree: u32,
    geometry: &B,
    sh: &B,
    records: &mut [Vec4],
    keys: &mut [u32],
    counters: &mut Counters,
) {
    // Beyond the last splat, a copy of it is projected and not written.
    let i = id.min(params.splats - 1);
    let splat = load(params, geometry, i);
    let s = shared::project(params, splat.camera, &splat.axes, splat.opacity);
    let [x0, y0, x1, y1] = shared::tile_box(params, &s);
    let seen = (s.log_opacity > shared::NOWHERE) & (x0 < x1) & (y0 < y1);
    // In front of the near plane: bits of positive floats are in the order of their values.
    let key = if seen { s.depth.to_bits() - params.near.to_bits() } else { shared::CULLED };
    let record = i * shared::RECORD;
    if seen {
        let [r, g, b] = colour(params, sh_degree, sh, i, splat.world);
        *at_mut(records, record) = Vec4::new(s.mean[0], s.mean[1], s.conic[0], s.conic[1]);
        *at_mut(records, record + 1) = Vec4::new(s.conic[2], s.log_opacity, s.sigma[0], s.sigma[1]);
        *at_mut(records, record + 2) = Vec4::new(r, g, b, s.depth);
        note(&mut counters.largest_key, key);
    }
    *at_mut(keys, i) = key;
    if id == params.splats {
        *at_mut(records, record + shared::RECORD) = Vec4::ZERO;
        *at_mut(records, record + shared::RECORD + 1) = Vec4::new(0.0, shared::NOWHERE, 0.0, 0.0);
        *at_mut(records, record + shared::RECORD + 2) = Vec4::new(0.0, 0.0, 0.0, 1.0);
    }
}

/// One invocation per splat, and one more, which makes the splat that shows nothing: binning pads with
/// it.
#[spirv(compute(threads(256)))]
pub fn project(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(spec_constant(id = 0, default = 3))] sh_degree: u32,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] geometry: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] sh: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] records: &mut [Vec4],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] keys: &mut [u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] counters: &mut Counters,
) {
    let params = *params;
    run(id.x, &params, sh_degree, geometry, sh, records, keys, counters);
}

/// As [`project`], two floats per access.
#[spirv(compute(threads(256)))]
pub fn project_lockstep(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(spec_constant(id = 0, default = 3))] sh_degree: u32,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] geometry: &[u64],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] sh: &[u64],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] records: &mut [Vec4],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] keys: &mut [u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] counters: &mut Counters,
) {
    let params = *params;
    run(id.x, &params, sh_degree, geometry, sh, records, keys, counters);
}
