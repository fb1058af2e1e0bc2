//! Blending a tile's splats front to back, in three forms: see `list`.

use crate::lanes::sync_subgroup;
use crate::list::{LANES, List, Power, SPLAT, Splat, largest, rgb_of, tell_cut};
use crate::rows::Rows;
use crate::shared::{Counters, Params, TILE, TRANSMITTANCE_STOP, tiles_per_group};
use core::arch::asm;
use spirv_std::arch::{IndexUnchecked, subgroup_any};
use spirv_std::glam::{UVec2, UVec3, Vec4};

/// The clamp of alpha. If all splats of a prior are less opaque, its pipelines have no clamp.
#[derive(Clone, Copy)]
pub struct Clamp {
    alpha: f32,
    there: bool,
}

impl Clamp {
    /// From a specialisation constant: 0 for no clamp.
    pub fn new(params: &Params, there: u32) -> Clamp {
        Clamp { alpha: params.alpha_max, there: there != 0 }
    }

    /// Whether it holds this alpha.
    pub fn holds(self, full: f32) -> bool {
        self.there & (full > self.alpha)
    }

    /// The alpha after it.
    pub fn of(self, full: f32) -> f32 {
        if self.there { least(full, self.alpha) } else { full }
    }
}

/// The smaller of two, neither of which is NaN, in one instruction.
fn least(a: f32, b: f32) -> f32 {
    let mut smaller = 0.0;
    // SAFETY: FMin (37) has no effect but its result.
    unsafe {
        asm! {
            "%glsl = OpExtInstImport \"GLSL.std.450\"",
            "%float = OpTypeFloat 32",
            "%a = OpLoad _ {a}",
            "%b = OpLoad _ {b}",
            "%smaller = OpExtInst %float %glsl 37 %a %b",
            "OpStore {to} %smaller",
            a = in(reg) &a,
            b = in(reg) &b,
            to = in(reg) &mut smaller,
        }
    }
    smaller
}

/// A splat's alphas at some pixels.
#[derive(Clone, Copy)]
pub struct Hits<R> {
    /// Before the clamp.
    full: R,
    /// 0 below the cut, and in finished pixels.
    pub alphas: R,
}

impl<R: Rows> Hits<R> {
    /// `transmittances`: in front of the splat.
    pub fn new<P: Power>(arguments: R, transmittances: R, clamp: Clamp) -> Hits<R> {
        let full = arguments.each(P::alpha);
        let held = full.each(|full| clamp.of(full));
        let above =
            arguments.both(held, |argument, alpha| if argument >= P::MIN { alpha } else { 0.0 });
        let alphas =
            transmittances.both(above, |t, alpha| if t > TRANSMITTANCE_STOP { alpha } else { 0.0 });
        Hits { full, alphas }
    }

    /// `values`, but 0 for pixels whose alpha is clamped.
    pub fn where_free(&self, values: R, clamp: Clamp) -> R {
        if !clamp.there {
            return values;
        }
        self.full.both(values, |full, value| if clamp.holds(full) { 0.0 } else { value })
    }
}

/// How to blend, by specialisation constants.
#[derive(Clone, Copy)]
pub struct How {
    pub clamp: Clamp,
    /// Whether depth is wanted beside the colours.
    pub depth: bool,
}

/// What a stage keeps of an invocation's pixels while it blends.
pub trait Blend: Copy {
    type Power: Power;
    type Rows: Rows;
    /// A splat's colour is given less that of the splat before it.
    const STEPS: bool;

    /// The splat as it is to be blended.
    fn prepared(s: Splat) -> Splat {
        s
    }

    /// Blends a splat into the pixels of column `x` at rows `y`, from the list's centre.
    fn blend(self, s: &Splat, x: f32, y: Self::Rows, how: How) -> Self;

    /// The largest transmittance. If it is at most [`TRANSMITTANCE_STOP`], all pixels are finished.
    fn left(&self) -> f32;
}

fn less([a, b, c]: [f32; 3], [x, y, z]: [f32; 3]) -> [f32; 3] {
    [a - x, b - y, c - z]
}

/// Plain: one splat after another. Returns the colour of the last splat, too.
pub fn plain<B: Blend>(
    list: List,
    first: u32,
    pixels: B,
    [x, y]: [f32; 2],
    how: How,
    counters: &mut Counters,
) -> (B, [f32; 3]) {
    let y = B::Rows::down(y);
    let (mut pixels, mut at, mut last) = (pixels, first, [0.0; 3]);
    while at < list.end {
        let s = B::prepared(list.load::<B::Power>(at));
        let rgb = if B::STEPS { less(s.rgb, last) } else { s.rgb };
        last = s.rgb;
        pixels = pixels.blend(&Splat { rgb, ..s }, x, y, how);
        at += 1;
        if pixels.left() <= TRANSMITTANCE_STOP {
            break;
        }
    }
    if (at < list.end) & (pixels.left() > TRANSMITTANCE_STOP) {
        tell_cut(counters);
    }
    (pixels, last)
}

/// The splat with the step of its colour, if the stage wants that, where each invocation of a subgroup of `LANES` holds
/// one splat. `last` is the colour of the splat before the first.
fn stepped<B: Blend, const LANES: u32>(own: &Splat, lane: u32, last: [f32; 3]) -> Splat {
    if !B::STEPS {
        return *own;
    }
    let before = rgb_of(own.rgb, lane.wrapping_sub(1) & (LANES - 1));
    Splat { rgb: less(own.rgb, if lane == 0 { last } else { before }), ..*own }
}

/// The colour of the splat that invocation `j` of the subgroup holds, if the stage wants steps.
fn last_of<B: Blend>(own: &Splat, j: u32) -> [f32; 3] {
    if B::STEPS { rgb_of(own.rgb, j) } else { own.rgb }
}

/// Lockstep: for subgroups of eight.
pub fn lockstep<B: Blend>(
    list: List,
    first: u32,
    pixels: B,
    [x, y]: [f32; 2],
    how: How,
    lane: u32,
    counters: &mut Counters,
) -> (B, [f32; 3]) {
    let y = B::Rows::down(y);
    let (mut pixels, mut at, mut last) = (pixels, first, [0.0; 3]);
    while at < list.end {
        let loaded = B::prepared(list.load::<B::Power>(at + lane));
        let own = stepped::<B, LANES>(&loaded, lane, last);
        last = last_of::<B>(&loaded, LANES - 1);
        pixels = pixels.blend(&own.of(0), x, y, how);
        pixels = pixels.blend(&own.of(1), x, y, how);
        pixels = pixels.blend(&own.of(2), x, y, how);
        pixels = pixels.blend(&own.of(3), x, y, how);
        pixels = pixels.blend(&own.of(4), x, y, how);
        pixels = pixels.blend(&own.of(5), x, y, how);
        pixels = pixels.blend(&own.of(6), x, y, how);
        pixels = pixels.blend(&own.of(7), x, y, how);
        at += LANES;
        if largest(pixels.left(), lane) <= TRANSMITTANCE_STOP {
            break;
        }
    }
    if (at < list.end) & (largest(pixels.left(), lane) > TRANSMITTANCE_STOP) {
        tell_cut(counters);
    }
    (pixels, last)
}

/// `Vec4`s of shared memory of a workgroup of the form for waves of `SUBGROUP`: a splat per invocation.
pub const fn wave_memory(subgroup: u32) -> usize {
    (tiles_per_group(subgroup) * subgroup * SPLAT) as usize
}

/// Splats between two looks at whether all pixels are finished.
const LOOK: u32 = 4;

/// Wave: for subgroups of `SUBGROUP`, a tile each, with no barrier between them. `slot` is the invocation's place in
/// shared memory.
pub fn wave<B: Blend, const SUBGROUP: u32, const MEMORY: usize>(
    list: List,
    first: u32,
    pixels: B,
    [x, y]: [f32; 2],
    how: How,
    (lane, slot): (u32, u32),
    shared: &mut [Vec4; MEMORY],
    counters: &mut Counters,
) -> (B, [f32; 3]) {
    let y = B::Rows::down(y);
    let (mut pixels, mut at, mut last, mut open) = (pixels, first, [0.0; 3], true);
    while open & (at < list.end) {
        let own = B::prepared(list.load::<B::Power>(at + lane));
        stepped::<B, SUBGROUP>(&own, lane, last).put(shared, slot);
        sync_subgroup();
        let (count, slot) = ((list.end - at).min(SUBGROUP), slot - lane);
        let mut j = 0;
        while open & (j < count) {
            // Beyond the list's end lie splats that show nowhere.
            pixels = pixels.blend(&Splat::get(shared, slot + j), x, y, how);
            pixels = pixels.blend(&Splat::get(shared, slot + j + 1), x, y, how);
            pixels = pixels.blend(&Splat::get(shared, slot + j + 2), x, y, how);
            pixels = pixels.blend(&Splat::get(shared, slot + j + 3), x, y, how);
            j += LOOK;
            open = subgroup_any(pixels.left() > TRANSMITTANCE_STOP);
        }
        last = last_of::<B>(&own, j - 1);
        sync_subgroup();
        at += j;
    }
    if open & (at < list.end) {
        tell_cut(counters);
    }
    (pixels, last)
}

/// The range of a tile.
pub fn range(params: &Params, ranges: &[UVec2], [x, y]: [u32; 2]) -> UVec2 {
    // SAFETY: the tile exists, and there is a range per tile.
    unsafe { *ranges.index_unchecked((y * params.tiles_x + x) as usize) }
}

/// Middle of a tile: its columns and rows lie at −3.5 to 3.5.
pub fn middle([x, y]: [u32; 2]) -> [f32; 2] {
    let half = (TILE / 2) as f32;
    [(x * TILE) as f32 + half, (y * TILE) as f32 + half]
}

/// Where an invocation's pixels lie.
#[derive(Clone, Copy)]
pub struct Place {
    pub tile: [u32; 2],
    /// The first pixel, from the tile's first one.
    column: u32,
    row: u32,
}

impl Place {
    /// One tile per workgroup; `rows` rows per invocation.
    pub fn of_group(group: UVec3, lane: u32, rows: u32) -> Place {
        Place { tile: [group.x, group.y], column: lane % TILE, row: lane / TILE * rows }
    }

    /// One tile per subgroup.
    pub fn of_subgroup<const SUBGROUP: u32>(group: UVec3, subgroup: u32, lane: u32) -> Place {
        let tile = [group.x * tiles_per_group(SUBGROUP) + subgroup, group.y];
        Place { tile, column: lane % TILE, row: lane / TILE * (TILE * TILE / SUBGROUP) }
    }

    /// The same, in the picture, of which only some rows of tiles are drawn.
    pub fn in_picture(self, params: &Params) -> Place {
        Place { tile: [self.tile[0], params.tile_row(self.tile[1])], ..self }
    }

    /// The first pixel, in the picture.
    pub fn pixel(self) -> [u32; 2] {
        [self.tile[0] * TILE + self.column, self.tile[1] * TILE + self.row]
    }

    /// The first pixel's middle, from the tile's.
    pub fn from_middle(self) -> [f32; 2] {
        [self.column as f32 - 3.5, self.row as f32 - 3.5]
    }
}
