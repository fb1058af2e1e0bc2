//! Stage `splat_flow`: blending with the optical-flow Jacobian. Splats are small. So a pixel's colour changes with the
//! pose nearly as if all that it shows moved with the flow of the pixel's own ray. Twelve sums per pixel (∂C/∂u, ∂C/∂v,
//! and both weighted by 1/z) replace the eighteen of the exact Jacobian. The derivatives follow from them after the
//! loop.
//!
//! A splat's weight is the transmittance before it less that behind it. So with colours `c` and transmittances `T`
//! before each splat, `C = Σ Tᵢ (cᵢ − cᵢ₋₁)`, and the derivatives likewise: a splat's own weight need not be derived.

use crate::blend::{
    Blend, Clamp, Hits, How, Place, lockstep, middle, plain, range, wave, wave_memory,
};
use crate::list::{LANES, List, Native, PRODUCT, Splat};
use crate::reduce::{Channels, Scratch, store, store_of_subgroup};
use crate::rows::Rows;
use crate::shared::{Counters, MASKED, Params, ROWS, tiles_per_group};
use spirv_std::glam::{UVec2, UVec3, Vec2, Vec4};
use spirv_std::spirv;

/// Some rows of a column. Colours are without what the last splat and the background show.
#[derive(Clone, Copy)]
struct Pixels<R> {
    rgb: [R; 3],
    transmittance: R,
    /// Derivatives along four motions, u, v, u/z, v/z; to be multiplied by [`PRODUCT`].
    d_r: [R; 4],
    d_g: [R; 4],
    d_b: [R; 4],
    d_transmittance: [R; 4],
}

/// `a + b scale`.
fn plus<R: Rows>(a: [R; 4], b: [R; 4], scale: f32) -> [R; 4] {
    let scale = R::all(scale);
    [a[0] + b[0] * scale, a[1] + b[1] * scale, a[2] + b[2] * scale, a[3] + b[3] * scale]
}

impl<R: Rows> Blend for Pixels<R> {
    type Power = Native;
    type Rows = R;
    const STEPS: bool = true;

    /// With its depth inverted.
    fn prepared(s: Splat) -> Splat {
        Splat { depth: 1.0 / s.depth, ..s }
    }

    fn blend(self, s: &Splat, x: f32, y: R, how: How) -> Pixels<R> {
        let column = s.along(x);
        let hits = Hits::new::<Native>(column.arguments(y), self.transmittance, how.clamp);
        let weights = hits.alphas * self.transmittance;
        // dα = −α v·dμ, v = Q d; nothing moves a clamped alpha. dT ← (1 − α) dT − T dα.
        let moved = hits.where_free(weights, how.clamp);
        let [v_x, v_y] = column.pull(y);
        let (u, v) = (moved * v_x, moved * v_y);
        let inverse_depth = R::all(s.depth);
        let kept = R::all(1.0) - hits.alphas;
        let (t, d) = (self.transmittance, self.d_transmittance);
        Pixels {
            rgb: [
                self.rgb[0] + t * R::all(s.rgb[0]),
                self.rgb[1] + t * R::all(s.rgb[1]),
                self.rgb[2] + t * R::all(s.rgb[2]),
            ],
            transmittance: t - weights,
            d_r: plus(self.d_r, d, s.rgb[0]),
            d_g: plus(self.d_g, d, s.rgb[1]),
            d_b: plus(self.d_b, d, s.rgb[2]),
            d_transmittance: [
                d[0] * kept + u,
                d[1] * kept + v,
                d[2] * kept + u * inverse_depth,
                d[3] * kept + v * inverse_depth,
            ],
        }
    }

    fn left(&self) -> f32 {
        self.transmittance.largest()
    }
}

impl<R: Rows> Pixels<R> {
    fn empty() -> Pixels<R> {
        let none = R::all(0.0);
        let still = [none, none, none, none];
        Pixels {
            rgb: [none, none, none],
            transmittance: R::all(1.0),
            d_r: still,
            d_g: still,
            d_b: still,
            d_transmittance: still,
        }
    }

    /// What the pixels from `(x, y)` down add to the normal equations: nothing if they are masked or outside of the
    /// picture. `last`: the colour of the last splat.
    fn channels(
        &self,
        params: &Params,
        frame: &[f32],
        [x, y]: [u32; 2],
        last: [f32; 3],
    ) -> Channels<R> {
        let (width, height) = (params.width, params.height);
        let (principal, focal) = (params.principal, params.focal);
        let column = (x as f32 + 0.5 - principal[0]) / focal[0];
        let row = R::down(y as f32 + 0.5).each(|y| (y - principal[1]) / focal[1]);
        let ray = [R::all(column), row];
        let (inside, left) = (x < width, (height - y.min(height)) as f32);
        let counted = R::down(0.5).each(|k| if inside & (k < left) { 1.0 } else { 0.0 });
        // Beyond the picture, the last pixels, which do not count.
        let (x, last_row) = (x.min(width - 1), height - 1);
        let first = params.frame_offset;
        let place = |k: u32| first + ((y + k).min(last_row) * width + x) * 3;
        let [a, b, c, d] = [place(0), place(1), place(2), place(3)];
        let frame = [
            R::load(frame, [a, b, c, d]),
            R::load(frame, [a + 1, b + 1, c + 1, d + 1]),
            R::load(frame, [a + 2, b + 2, c + 2, d + 2]),
        ];
        let counted = frame[0].both(counted, |r, c| if r <= MASKED { 0.0 } else { c });
        let (focal, transmittance) = ([focal[0] * PRODUCT, focal[1] * PRODUCT], self.transmittance);
        let moved = self.d_transmittance;
        let channel = |frame: R, behind: f32, rgb: R, d: [R; 4]| {
            let residual = rgb + transmittance * R::all(behind) - frame;
            let [a, b, c, d, e, f] = pose_derivative(focal, ray, plus(d, moved, behind));
            let only = |value: R| value.both(counted, |value, c| if c > 0.0 { value } else { 0.0 });
            [only(a), only(b), only(c), only(d), only(e), only(f), only(residual)]
        };
        let background = params.background;
        [
            channel(frame[0], background[0] - last[0], self.rgb[0], self.d_r),
            channel(frame[1], background[1] - last[1], self.rgb[1], self.d_g),
            channel(frame[2], background[2] - last[2], self.rgb[2], self.d_b),
        ]
    }
}

/// One channel's derivative with respect to the pose from its four motions, at the ray `(x, y)`:
/// `du = fx (ρx − x ρz)/z + fx (−xy θx + (1 + x²) θy − y θz)`, `dv` likewise.
fn pose_derivative<R: Rows>(focal: [f32; 2], [x, y]: [R; 2], d: [R; 4]) -> [R; 6] {
    let (fx, fy) = (R::all(focal[0]), R::all(focal[1]));
    let (u, v) = (fx * d[0], fy * d[1]);
    let (u_z, v_z) = (fx * d[2], fy * d[3]);
    let one = R::all(1.0);
    [
        u_z,
        v_z,
        -(x * u_z + y * v_z),
        -(x * y * u) - (one + y * y) * v,
        (one + x * x) * u + x * y * v,
        x * v - y * u,
    ]
}

/// Plain: one workgroup per tile.
#[spirv(compute(threads(16)))]
pub fn splat_flow(
    #[spirv(workgroup_id)] group: UVec3,
    #[spirv(local_invocation_index)] lane: u32,
    #[spirv(workgroup)] scratch: &mut Scratch,
    #[spirv(spec_constant(id = 1, default = 1))] clamp: u32,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] ranges: &[UVec2],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] pair_splats: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] records: &[Vec4],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] frame: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] partials: &mut [f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 6)] counters: &mut Counters,
) {
    let place = Place::of_group(group, lane, ROWS);
    let range = range(params, ranges, place.tile);
    let place = place.in_picture(params);
    let list = List { records, pair_splats, end: range.y, centre: middle(place.tile) };
    let how = How { clamp: Clamp::new(params, clamp), depth: true };
    let pixels = Pixels::<Vec4>::empty();
    let (pixels, last) = plain(list, range.x, pixels, place.from_middle(), how, counters);
    let channels = pixels.channels(params, frame, place.pixel(), last);
    store(&channels, lane, group.y * params.tiles_x + group.x, scratch, partials);
}

/// Lockstep: one workgroup per tile, with two subgroups for one half of the tile each. With one subgroup for all eight
/// rows the instructions would take 40 KB, and more time, although loads would halve: docs/decisions.md, 7.
#[spirv(compute(threads(16)))]
pub fn splat_flow_lockstep(
    #[spirv(workgroup_id)] group: UVec3,
    #[spirv(subgroup_id)] half: u32,
    #[spirv(subgroup_local_invocation_id)] lane: u32,
    #[spirv(workgroup)] scratch: &mut Scratch,
    #[spirv(spec_constant(id = 1, default = 1))] clamp: u32,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] ranges: &[UVec2],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] pair_splats: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] records: &[Vec4],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] frame: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] partials: &mut [f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 6)] counters: &mut Counters,
) {
    let place = Place::of_group(group, half * LANES + lane, ROWS);
    let range = range(params, ranges, place.tile);
    let place = place.in_picture(params);
    // Seen from the middle of the half's upper row, so that few terms remain.
    let [x, y] = middle(place.tile);
    let centre = [x, y - 3.5 + (half * ROWS) as f32];
    let list = List { records, pair_splats, end: range.y, centre };
    let how = How { clamp: Clamp::new(params, clamp), depth: true };
    let first = [place.from_middle()[0], 0.0];
    let pixels = Pixels::<Vec4>::empty();
    let (pixels, last) = lockstep(list, range.x, pixels, first, how, lane, counters);
    let channels = pixels.channels(params, frame, place.pixel(), last);
    store(&channels, half * LANES + lane, group.y * params.tiles_x + group.x, scratch, partials);
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
            #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] ranges: &[UVec2],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] pair_splats: &[u32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] records: &[Vec4],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] frame: &[f32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] partials: &mut [f32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 6)] counters: &mut Counters,
        ) {
            let place = Place::of_subgroup::<$subgroup>(group, subgroup, lane);
            if place.tile[0] >= params.tiles_x {
                return;
            }
            let (range, drawn) = (range(params, ranges, place.tile), place.tile);
            let place = place.in_picture(params);
            let list = List { records, pair_splats, end: range.y, centre: middle(place.tile) };
            let how = How { clamp: Clamp::new(params, clamp), depth: true };
            let pixels = Pixels::<$rows>::empty();
            let lanes = (lane, subgroup * $subgroup + lane);
            let (pixels, last) = wave::<_, $subgroup, { wave_memory($subgroup) }>(
                list,
                range.x,
                pixels,
                place.from_middle(),
                how,
                lanes,
                splats,
                counters,
            );
            let channels = pixels.channels(params, frame, place.pixel(), last);
            let tile = drawn[1] * params.tiles_x + drawn[0];
            store_of_subgroup::<_, $subgroup>(&channels, lane, tile, partials);
        }
    };
}

wave_form!(splat_flow_wave16, 16, 16, Vec4);
wave_form!(splat_flow_wave32, 32, 128, Vec2);
wave_form!(splat_flow_wave64, 64, 128, f32);
