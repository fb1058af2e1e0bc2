//! Stage `project`: each splat's mean, conic, colour and depth as the camera sees it, and its key for the sort by
//! depth. It also counts the keys by the digit that is sorted by first. If the picture's pose is coded, it places the
//! camera: encoder and decoder both do so here, and so draw at the same pose, bit for bit.

use crate::counters;
use crate::lanes::{Lanes, Lockstep, Scratch, Shared, Table};
use crate::memory::{Pairs, at_mut};
use crate::radix::{digit_of, table};
use crate::search::{placed, set_pose};
use crate::shared::{self, CULLED, Counters, Params, SORT_STEP};
use crate::solve::Coded;
use spirv_std::glam::{UVec3, Vec4};
use spirv_std::spirv;

/// How to project.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct View {
    /// 1: the camera is at the coded pose; 0: at that of the parameters.
    pub coded: u32,
    /// The digit that is sorted by first.
    pub digit: u32,
    /// Logarithm, base 2, of the number of blocks that share the splats.
    pub log_blocks: u32,
}

/// Position, opacity and the scaled axes turned into camera coordinates.
pub struct Splat {
    pub world: [f32; 3],
    pub camera: [f32; 3],
    pub opacity: f32,
    pub axes: [[f32; 3]; 3],
}

/// The pair of splat `i` in a plane with room for `stride` splats. (A closure would hold the buffer in a structure,
/// which crashes SwiftShader.)
fn of_plane<B: Pairs + ?Sized>(planes: &B, plane: u32, stride: u32, i: u32) -> [f32; 2] {
    // The host allocated these planes, with room for so many splats each.
    planes.pair(plane * stride + i)
}

/// Reads splat `i` from its planes.
pub fn load<B: Pairs + ?Sized>(params: &Params, geometry: &B, i: u32) -> Splat {
    let n = params.stride;
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
    let (n, first) = (params.stride, 3 * two);
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
    // Written out: in a loop the basis would lie in memory.
    macro_rules! add {
        ($($two:literal)+) => {
            $(if 2 * $two < count {
                let [one, other] = coefficients(params, sh, $two, i);
                let (b, c) = (basis[2 * $two], basis[2 * $two + 1]);
                rgb = [rgb[0] + b * one[0], rgb[1] + b * one[1], rgb[2] + b * one[2]];
                rgb = [rgb[0] + c * other[0], rgb[1] + c * other[1], rgb[2] + c * other[2]];
            })+
        };
    }
    add!(0 1 2 3 4 5 6 7);
    [shared::shown(rgb[0]), shared::shown(rgb[1]), shared::shown(rgb[2])]
}

/// Projects splat `i` and writes its record, if it is seen, and its key, unless another invocation does so. Returns the
/// key.
fn one<B: Pairs + ?Sized>(
    i: u32,
    writes: bool,
    params: &Params,
    sh_degree: u32,
    geometry: &B,
    sh: &B,
    records: &mut [Vec4],
    keys: &mut [u32],
) -> u32 {
    let splat = load(params, geometry, i);
    let s = shared::project(params, splat.camera, &splat.axes, splat.opacity);
    let [x0, y0, x1, y1] = shared::tile_box(params, &s);
    let seen = (s.log_opacity > shared::NOWHERE) & (x0 < x1) & (y0 < y1);
    // In front of the near plane: bits of positive floats are in the order of their values.
    let key = if seen { s.depth.to_bits() - params.near.to_bits() } else { CULLED };
    let record = i * shared::RECORD;
    if seen & writes {
        let [r, g, b] = colour(params, sh_degree, sh, i, splat.world);
        *at_mut(records, record) = Vec4::new(s.mean[0], s.mean[1], s.conic[0], s.conic[1]);
        *at_mut(records, record + 1) = Vec4::new(s.conic[2], s.log_opacity, s.sigma[0], s.sigma[1]);
        *at_mut(records, record + 2) = Vec4::new(r, g, b, s.depth);
    }
    if writes {
        *at_mut(keys, i) = key;
    }
    key
}

/// Makes the record after the last splat's, which shows nothing: binning pads with it.
fn make_empty(splats: u32, records: &mut [Vec4]) {
    let record = splats * shared::RECORD;
    *at_mut(records, record) = Vec4::ZERO;
    *at_mut(records, record + 1) = Vec4::new(0.0, shared::NOWHERE, 0.0, 0.0);
    *at_mut(records, record + 2) = Vec4::new(0.0, 0.0, 0.0, 1.0);
}

#[allow(clippy::too_many_arguments)]
fn run<L: Lanes, B: Pairs + ?Sized>(
    block: u32,
    lane: u32,
    bins: &mut Table,
    scratch: &mut Scratch,
    view: &View,
    coded: &Coded,
    sh_degree: u32,
    params: &Params,
    geometry: &B,
    sh: &B,
    records: &mut [Vec4],
    keys: &mut [u32],
    counters: &mut Counters,
    histogram: &mut [u32],
) {
    let mut params = *params;
    if view.coded == 1 {
        set_pose(&mut params, &placed(&coded.code, &coded.anchor));
    }
    let bits = shared::digit_bits(shared::largest_key(&params));
    if (block == 0) & (lane == 0) {
        counters.digit_bits = bits;
        counters.pairs_needed = 0;
        counters.splats = params.splats;
        make_empty(params.splats, records);
    }
    let table = table(bits, view.log_blocks, view.digit);
    counters::clear::<L, _>(bins, table.width, lane);
    let [first, end] = shared::block(params.splats, view.log_blocks, block, SORT_STEP);
    let mut place = first + lane;
    while place - lane < end {
        // Beyond the last splat, it is projected again, and neither written nor counted.
        let there = place < end;
        let key = one(place.min(end - 1), there, &params, sh_degree, geometry, sh, records, keys);
        let counted = there & (key != CULLED);
        L::tally(bins, digit_of(key, bits, view.digit), 1, counted, lane, scratch);
        place += L::COUNT;
    }
    counters::leave::<L>(bins, &table, block, lane, histogram);
}

/// Makes a form of the stage: its entry point, invocations of a workgroup, and how planes are loaded. One workgroup per
/// block of splats.
macro_rules! form {
    ($name:ident, $threads:tt, $lanes:ty, $plane:ty) => {
        /// Projects the splats of a block and counts their keys.
        #[spirv(compute(threads($threads)))]
        pub fn $name(
            #[spirv(workgroup_id)] group: UVec3,
            #[spirv(local_invocation_index)] lane: u32,
            #[spirv(spec_constant(id = 0, default = 3))] sh_degree: u32,
            #[spirv(workgroup)] bins: &mut Table,
            #[spirv(workgroup)] scratch: &mut Scratch,
            #[spirv(push_constant)] view: &View,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] geometry: &[$plane],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] sh: &[$plane],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] records: &mut [Vec4],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] keys: &mut [u32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] counters: &mut Counters,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 6)] histogram: &mut [u32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 7)] coded: &Coded,
        ) {
            run::<$lanes, _>(
                group.x, lane, bins, scratch, view, coded, sh_degree, params, geometry, sh,
                records, keys, counters, histogram,
            );
        }
    };
}

form!(project, 128, Shared<128>, f32);
form!(project_lockstep, 8, Lockstep, u64);
