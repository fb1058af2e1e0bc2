//! Stage `splat`: front-to-back blending (Kerbl et al. 2023, eq. 3). A pixel is finished once its
//! transmittance is at most [`TRANSMITTANCE_STOP`](shared::TRANSMITTANCE_STOP): no further splat counts.

use crate::blend::{
    Blend, Clamp, Hits, How, Place, lockstep, middle, plain, range, wave, wave_memory,
};
use crate::list::{List, Portable, Splat};
use crate::rows::Rows;
use crate::shared::{self, Counters, Params, ROWS, TILE, max, tiles_per_group};
use spirv_std::glam::{UVec2, UVec3, Vec2, Vec4};
use spirv_std::spirv;

/// Some rows of a column.
#[derive(Clone, Copy)]
struct Pixels<R> {
    rgb: [R; 3],
    depth: R,
    transmittance: R,
}

impl<R: Rows> Pixels<R> {
    fn empty() -> Pixels<R> {
        let none = R::all(0.0);
        Pixels { rgb: [none, none, none], depth: none, transmittance: R::all(1.0) }
    }

    /// Writes `rows` rows from pixel `(x, y)` down.
    fn store(&self, params: &Params, out: &mut [f32], [x, y]: [u32; 2], rows: u32) {
        let mut k = 0;
        while k < rows {
            let [r, g, b] = self.rgb;
            let pixel = [r.of(k), g.of(k), b.of(k), self.depth.of(k), self.transmittance.of(k)];
            store(params, out, x, y + k, pixel);
            k += 1;
        }
    }
}

impl<R: Rows> Blend for Pixels<R> {
    type Power = Portable;
    type Rows = R;
    const STEPS: bool = false;

    fn blend(self, s: &Splat, x: f32, y: R, how: How) -> Pixels<R> {
        let hits = Hits::new::<Portable>(s.along(x).arguments(y), self.transmittance, how.clamp);
        let weights = hits.alphas * self.transmittance;
        Pixels {
            rgb: [
                self.rgb[0] + weights * R::all(s.rgb[0]),
                self.rgb[1] + weights * R::all(s.rgb[1]),
                self.rgb[2] + weights * R::all(s.rgb[2]),
            ],
            depth: if how.depth { self.depth + weights * R::all(s.depth) } else { self.depth },
            transmittance: self.transmittance - weights,
        }
    }

    fn left(&self) -> f32 {
        self.transmittance.largest()
    }
}

fn store(params: &Params, out: &mut [f32], x: u32, y: u32, p: [f32; 5]) {
    if (x < params.width) & (y < params.height) {
        let at = ((y * params.width + x) * shared::PIXEL) as usize;
        let [r, g, b, depth, t] = p;
        out[at] = r + t * params.background[0];
        out[at + 1] = g + t * params.background[1];
        out[at + 2] = b + t * params.background[2];
        out[at + 3] = depth;
        out[at + 4] = t;
    }
}

/// Plain: one workgroup per tile.
#[spirv(compute(threads(16)))]
pub fn splat(
    #[spirv(workgroup_id)] group: UVec3,
    #[spirv(local_invocation_index)] lane: u32,
    #[spirv(spec_constant(id = 1, default = 1))] clamp: u32,
    #[spirv(spec_constant(id = 2, default = 1))] depth: u32,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] ranges: &[UVec2],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] pair_splats: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] records: &[Vec4],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] out: &mut [f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] counters: &mut Counters,
) {
    let place = Place::of_group(group, lane, ROWS);
    let range = range(params, ranges, place.tile);
    let list = List { records, pair_splats, end: range.y, centre: middle(place.tile) };
    let how = How { clamp: Clamp::new(params, clamp), depth: depth != 0 };
    let pixels = Pixels::<Vec4>::empty();
    let (pixels, _) = plain(list, range.x, pixels, place.from_middle(), how, counters);
    pixels.store(params, out, place.pixel(), ROWS);
}

/// The whole column of a tile.
#[derive(Clone, Copy)]
struct Whole(Pixels<Vec4>, Pixels<Vec4>);

impl Blend for Whole {
    type Power = Portable;
    type Rows = Vec4;
    const STEPS: bool = false;

    fn blend(self, s: &Splat, x: f32, y: Vec4, how: How) -> Whole {
        Whole(self.0.blend(s, x, y, how), self.1.blend(s, x, y + Vec4::splat(4.0), how))
    }

    fn left(&self) -> f32 {
        max(self.0.left(), self.1.left())
    }
}

/// Lockstep: one workgroup per tile.
#[spirv(compute(threads(8)))]
pub fn splat_lockstep(
    #[spirv(workgroup_id)] group: UVec3,
    #[spirv(subgroup_local_invocation_id)] lane: u32,
    #[spirv(spec_constant(id = 1, default = 1))] clamp: u32,
    #[spirv(spec_constant(id = 2, default = 1))] depth: u32,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] ranges: &[UVec2],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] pair_splats: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] records: &[Vec4],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] out: &mut [f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] counters: &mut Counters,
) {
    let tile = [group.x, group.y];
    let range = range(params, ranges, tile);
    let list = List { records, pair_splats, end: range.y, centre: middle(tile) };
    let how = How { clamp: Clamp::new(params, clamp), depth: depth != 0 };
    let pixels = Whole(Pixels::empty(), Pixels::empty());
    let first = [lane as f32 - 3.5, -3.5];
    let (pixels, _) = lockstep(list, range.x, pixels, first, how, lane, counters);
    let (x, y) = (group.x * TILE + lane, group.y * TILE);
    pixels.0.store(params, out, [x, y], ROWS);
    pixels.1.store(params, out, [x, y + ROWS], ROWS);
}

/// Makes a wave form: one tile per subgroup of so many invocations, workgroups of so many, and rows of this type.
macro_rules! wave_form {
    ($name:ident, $subgroup:literal, $threads:tt, $rows:ty) => {
        const _: () = assert!(tiles_per_group($subgroup) * $subgroup == $threads);

        /// Wave: one tile per subgroup.
        #[spirv(compute(threads($threads)))]
        pub fn $name(
            #[spirv(workgroup_id)] group: UVec3,
            #[spirv(subgroup_id)] subgroup: u32,
            #[spirv(subgroup_local_invocation_id)] lane: u32,
            #[spirv(workgroup)] splats: &mut [Vec4; wave_memory($subgroup)],
            #[spirv(spec_constant(id = 1, default = 1))] clamp: u32,
            #[spirv(spec_constant(id = 2, default = 1))] depth: u32,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] ranges: &[UVec2],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] pair_splats: &[u32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] records: &[Vec4],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] out: &mut [f32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] counters: &mut Counters,
        ) {
            let place = Place::of_subgroup::<$subgroup>(group, subgroup, lane);
            if place.tile[0] >= params.tiles_x {
                return;
            }
            let range = range(params, ranges, place.tile);
            let list = List { records, pair_splats, end: range.y, centre: middle(place.tile) };
            let how = How { clamp: Clamp::new(params, clamp), depth: depth != 0 };
            let pixels = Pixels::<$rows>::empty();
            let lanes = (lane, subgroup * $subgroup + lane);
            let (pixels, _) = wave::<_, $subgroup, { wave_memory($subgroup) }>(
                list,
                range.x,
                pixels,
                place.from_middle(),
                how,
                lanes,
                splats,
                counters,
            );
            pixels.store(params, out, place.pixel(), TILE * TILE / $subgroup);
        }
    };
}

wave_form!(splat_wave16, 16, 16, Vec4);
wave_form!(splat_wave32, 32, 128, Vec2);
wave_form!(splat_wave64, 64, 128, f32);
