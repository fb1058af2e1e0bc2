//! Constants, buffer layouts and maths that the shaders and the host share; nothing here may need the GPU.

use crate::portable;
#[cfg(target_arch = "spirv")]
use spirv_std::num_traits::Float;

/// Side of a square tile, pixels.
pub const TILE: u32 = 8;
/// Invocations of a splatting workgroup: one per column of [`ROWS`] pixels.
pub const SPLAT_THREADS: u32 = TILE * TILE / ROWS;
/// Pixels of one column that one invocation blends: a splat's record is loaded once for all of them.
pub const ROWS: u32 = 4;
/// Tiles that a workgroup of subgroups of this size draws, one per subgroup. It is one at 16: if a workgroup has
/// several subgroups, Mesa 25's llvmpipe takes a barrier of one of them for a barrier of all, and draws other pictures.
pub const fn tiles_per_group(subgroup: u32) -> u32 {
    if subgroup == 16 { 1 } else { 128 / subgroup }
}
/// Invocations of a workgroup with one splat or one pair per invocation.
pub const GROUP: u32 = 256;
/// Digits of a depth key. The sort takes one pass per digit.
pub const DIGITS: u32 = 3;
/// Counters of a counting stage's workgroup in shared memory: one per digit of the widest pass, or one per tile of a
/// band. They take 8 KiB, half of what every device has.
pub const TABLE: u32 = 2048;
/// Most tiles of a band, unless it is binned in lockstep: [`TABLE`] holds a place and an end for each.
pub const BIN_TABLE: u32 = TABLE / 2;
/// Counters of a workgroup of stage `radix_scatter` in the forms for waves.
pub const SCATTER_TABLES: u32 = 4096;
/// Sums over these.
pub const SCATTER_TOTALS: u32 = 8;
/// Shared memory that the forms for waves need, bytes.
pub const WAVE_MEMORY: u32 = 4 * (SCATTER_TABLES + SCATTER_TOTALS);
/// Counters of a workgroup that bins in lockstep: 32 KiB. Each band goes through all splats, so a CPU, which has no use
/// for several workgroups per core, wants few bands.
pub const LOCKSTEP_TABLE: u32 = 8192;
/// Planes of the `geometry` buffer, of a pair of floats per splat: position, opacity, 3×3 axes, a spare.
pub const GEOMETRY_PLANES: u32 = 7;
/// `Vec4`s of a projected splat's record.
pub const RECORD: u32 = 3;
/// `Vec4`s of a projected splat's pose derivatives, exact Jacobian only; see stage `pose_jacobian`.
pub const DERIVATIVES: u32 = 12;
/// Sums of the normal equations: 21 of JᵀJ (upper triangle, row by row), 6 of Jᵀr, 1 of r².
pub const SUMS: u32 = 28;
/// Side of a cell of a flat field, pixels of the frame.
pub const CELL: u32 = 16;
/// Floats before the cells in the buffer of a frame's light: factors, summands, number of columns, number of rows.
pub const LIGHT: u32 = 8;
/// Value of a frame's pixels that do not count in the normal equations. Pixels that count are far above.
pub const MASKED: f32 = -1e9;
/// Floats of a rendered pixel: linear R, G, B, depth Σ wᵢ zᵢ, transmittance.
pub const PIXEL: u32 = 5;
/// Most levels of the pyramid.
pub const LEVELS: usize = 8;
/// Depth key of a splat that touches no tile; it is not sorted.
pub const CULLED: u32 = u32::MAX;

/// Kernel `ceiling_arithmetic`: chains of multiply-adds of an invocation.
pub const CEILING_CHAINS: u32 = 16;
/// Steps of each chain in one turn of the loop.
pub const CEILING_STEPS: u32 = 8;
/// Turns of the loop.
pub const CEILING_TURNS: u32 = 512;

/// Low-pass of the full picture, added to the diagonal of the 2D covariance, pixels² (Kerbl et al.
/// 2023).
pub const DILATION: f32 = 0.3;
/// Least ratio of determinants that opacity compensates (gsplat).
pub const RATIO_MIN: f32 = 2.5e-5;

/// Low-pass of a picture reduced by `factor`, and the part of it that opacity does not compensate,
/// both in pixels² of that picture. The full picture's low-pass makes splats fatter; in
/// anti-aliased priors a lower opacity compensates that (gsplat). At a reduced level, splats may be
/// fatter only by the full picture's low-pass, which is smaller there. Else the level would not
/// show the same as the frame, which is reduced by averaging: docs/decisions.md, 5.
pub fn low_pass(antialiased: bool, factor: u32) -> [f32; 2] {
    let kept = DILATION / (factor * factor) as f32;
    [DILATION, if antialiased { 0.0 } else { kept }]
}
/// Alpha below this is skipped.
pub const ALPHA_MIN: f32 = 1.0 / 255.0;
/// Blending multiplies the conic's factor by this, `√(½ log₂ e)`. Log₂ of alpha is then a difference of squares.
pub const FACTOR: f32 = 0.849_321_8;
/// The same for the argument of [`portable::power`]: [`FACTOR`] times the root of [`portable::POWER_SCALE`].
pub const POWER_FACTOR: f32 = 0.103_991_71;
/// log₂ of [`ALPHA_MIN`].
pub const LOG_ALPHA_MIN: f32 = -7.994_353_4;
/// The argument of [`portable::power`] at [`ALPHA_MIN`].
pub const POWER_MIN: f32 = portable::POWER_SHIFT + portable::POWER_SCALE * LOG_ALPHA_MIN;
/// log₂ of the opacity of a splat that shows nowhere.
pub const NOWHERE: f32 = -1000.0;
/// A pixel whose transmittance is this or below is finished: no further splat counts.
pub const TRANSMITTANCE_STOP: f32 = 1e-4;
/// Largest extent of a splat, standard deviations.
pub const EXTENT_MAX: f32 = 3.33;
/// Frustum margin of the projection Jacobian, in tan(fov/2).
pub const FRUSTUM_MARGIN: f32 = 0.3;

/// What one render needs to know; written by the host before each submission.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(not(target_arch = "spirv"), derive(bytemuck::Pod, bytemuck::Zeroable))]
pub struct Params {
    /// World-to-camera rotation, row-major.
    pub rotation: [f32; 9],
    /// World-to-camera translation.
    pub translation: [f32; 3],
    /// Camera centre in the world.
    pub centre: [f32; 3],
    /// Focal lengths, pixels.
    pub focal: [f32; 2],
    /// Principal point, pixels.
    pub principal: [f32; 2],
    /// Least and greatest x/z, then y/z, of the frustum and its margin: see [`frustum`].
    pub frustum: [f32; 4],
    /// Background, linear RGB.
    pub background: [f32; 3],
    /// Near plane.
    pub near: f32,
    /// No splat's middle is further than this from the point that positions are relative to.
    pub radius: f32,
    /// Clamp of alpha.
    pub alpha_max: f32,
    /// Low-pass added to the diagonal of the 2D covariance, pixels²: see [`low_pass`].
    pub dilation: f32,
    /// How much of it opacity does not compensate.
    pub dilation_kept: f32,
    /// Picture width, pixels.
    pub width: u32,
    /// Picture height, pixels.
    pub height: u32,
    /// Tiles across.
    pub tiles_x: u32,
    /// Rows of tiles that are drawn.
    pub tiles_y: u32,
    /// Number of splats.
    pub splats: u32,
    /// How many splats the planes of splats have room for.
    pub stride: u32,
    /// Room for (tile, splat) pairs.
    pub pair_capacity: u32,
    /// Where this level's floats begin in the buffer of frames.
    pub frame_offset: u32,
    /// Workgroups that share the sort of the splats.
    pub sort_blocks: u32,
    /// Workgroups that share their binning.
    pub bin_blocks: u32,
    /// Rows of tiles of a band: each workgroup bins splats into one band.
    pub band_rows: u32,
    /// Tiles that a workgroup draws.
    pub tiles_per_group: u32,
    /// Of each 2^`row_shift` rows of tiles of the picture one is drawn: see [`Params::tile_row`].
    pub row_shift: u32,
    /// The first of them.
    pub row_first: u32,
}

impl Params {
    /// Rows of tiles of the whole picture.
    pub fn picture_rows(&self) -> u32 {
        self.height.div_ceil(TILE)
    }

    /// The picture's row of tiles that row `drawn` of those drawn is.
    pub fn tile_row(&self, drawn: u32) -> u32 {
        (drawn << (self.row_shift & 31)) + self.row_first
    }

    /// Number of drawn rows of tiles before the picture's row `row`.
    pub fn drawn_before(&self, row: u32) -> u32 {
        let step = 1 << (self.row_shift & 31);
        (row + step - 1 - self.row_first) >> (self.row_shift & 31)
    }

    /// Whether the picture's row `row` of tiles is drawn.
    pub fn draws(&self, row: u32) -> bool {
        let step = 1 << (self.row_shift & 31);
        row % step == self.row_first
    }

    /// These parameters, with one of each 2^`shift` rows of tiles drawn. Those drawn lie around the picture's middle.
    pub fn with_rows(self, shift: u32) -> Params {
        let (rows, step) = (self.picture_rows(), 1 << (shift & 31));
        let row_first = (rows - 1) % step / 2;
        let params = Params { row_shift: shift, row_first, ..self };
        Params { tiles_y: params.drawn_before(rows), ..params }
    }
}

/// A level of the pyramid.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(not(target_arch = "spirv"), derive(bytemuck::Pod, bytemuck::Zeroable))]
pub struct PyramidLevel {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// Side of the block of pixels of the frame that becomes one.
    pub factor: u32,
}

impl PyramidLevel {
    /// Pixels of the level.
    pub fn pixels(&self) -> u32 {
        self.width * self.height
    }
}

/// What stage `pyramid` makes. The levels' floats lie one after the other.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(not(target_arch = "spirv"), derive(bytemuck::Pod, bytemuck::Zeroable))]
pub struct PyramidLevels {
    /// Width of the frame, pixels.
    pub frame_width: u32,
    /// Number of levels.
    pub count: u32,
    /// The levels.
    pub levels: [PyramidLevel; LEVELS],
}

/// Indirect dispatches of the stages at one level; zeros if nothing is to run.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(not(target_arch = "spirv"), derive(bytemuck::Pod, bytemuck::Zeroable))]
pub struct Groups {
    /// An invocation per splat.
    pub splats: [u32; 3],
    /// A workgroup per block of splats to sort.
    pub sort_blocks: [u32; 3],
    /// A workgroup per block of splats to bin, times the bands of tiles.
    pub bin_blocks: [u32; 3],
    /// A workgroup per band of tiles.
    pub bands: [u32; 3],
    /// A workgroup per tile.
    pub tiles: [u32; 3],
    /// A workgroup per so many tiles of a row as it draws.
    pub tile_groups: [u32; 3],
    /// An invocation per word of four bytes of an 8-bit picture.
    pub byte_words: [u32; 3],
    /// One workgroup.
    pub one: [u32; 3],
}

impl Groups {
    /// Nothing is run.
    pub const NONE: Groups = Groups {
        splats: [0, 1, 1],
        sort_blocks: [0, 1, 1],
        bin_blocks: [0, 1, 1],
        bands: [0, 1, 1],
        tiles: [0, 1, 1],
        tile_groups: [0, 1, 1],
        byte_words: [0, 1, 1],
        one: [0, 1, 1],
    };

    /// The dispatches of a level.
    pub fn of(params: &Params) -> Groups {
        // One more for the splat that shows nothing.
        let splats = params.splats + 1;
        let bands = params.tiles_y.div_ceil(params.band_rows);
        Groups {
            splats: [splats.div_ceil(GROUP), 1, 1],
            sort_blocks: [params.sort_blocks, 1, 1],
            bin_blocks: [params.bin_blocks, bands, 1],
            bands: [bands, 1, 1],
            tiles: [params.tiles_x, params.tiles_y, 1],
            tile_groups: [params.tiles_x.div_ceil(params.tiles_per_group), params.tiles_y, 1],
            byte_words: [(params.width * params.height * 3).div_ceil(4 * GROUP), 1, 1],
            one: [1, 1, 1],
        }
    }
}

/// Numbers that the stages give each other and, after the render, the host.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(not(target_arch = "spirv"), derive(bytemuck::Pod, bytemuck::Zeroable))]
pub struct Counters {
    /// Pairs that the picture needs. If this is more than the capacity, some were left out.
    pub pairs_needed: u32,
    /// Splats whose bounding box touches a tile.
    pub visible: u32,
    /// Bits of a digit of the depth keys.
    pub digit_bits: u32,
    /// Splats that were projected.
    pub splats: u32,
}

/// A splat as seen from the camera, before anything of the picture is known.
#[derive(Clone, Copy)]
pub struct Projected {
    /// Mean, pixels.
    pub mean: [f32; 2],
    /// Factor `(l11, l21, l22)` of the conic: `q = (l11 dx + l21 dy)² + (l22 dy)²`.
    pub conic: [f32; 3],
    /// Standard deviations along the picture's axes, pixels.
    pub sigma: [f32; 2],
    /// log₂ of the opacity, which is compensated if the prior is anti-aliased; [`NOWHERE`] if the splat is culled.
    pub log_opacity: f32,
    /// Camera z.
    pub depth: f32,
}

impl Projected {
    /// A splat that shows nowhere.
    pub const CULLED: Projected = Projected {
        mean: [0.0; 2],
        conic: [0.0; 3],
        sigma: [0.0; 2],
        log_opacity: NOWHERE,
        depth: 1.0,
    };
}

/// The larger of two; a NaN gives `b`.
pub fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The smaller of two; a NaN gives `b`.
pub fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// `x` limited to `[low, high]`; a NaN gives `low`.
pub fn clamp(x: f32, low: f32, high: f32) -> f32 {
    min(max(x, low), high)
}

/// A linear value as a byte: clamped, rounded to nearest; a NaN gives 0.
pub fn to_byte(value: f32) -> u32 {
    let low = if value > 0.0 { value } else { 0.0 };
    let high = if low < 1.0 { low } else { 1.0 };
    (high * 255.0 + 0.5) as u32
}

/// A colour's channel, finite and not negative. If it is so dark that blending would give denormals, it becomes black.
pub fn shown(channel: f32) -> f32 {
    if channel > 1e-20 { min(channel, f32::MAX) } else { 0.0 }
}

/// Scalar product.
pub fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Vector product.
pub fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// A row-major 3×3 matrix times a vector.
pub fn transform(m: &[f32; 9], v: [f32; 3]) -> [f32; 3] {
    [
        m[0] * v[0] + m[1] * v[1] + m[2] * v[2],
        m[3] * v[0] + m[4] * v[1] + m[5] * v[2],
        m[6] * v[0] + m[7] * v[1] + m[8] * v[2],
    ]
}

/// [`Params::frustum`] along one axis, from a side's length, the focal length and the principal point.
pub fn frustum(side: u32, focal: f32, principal: f32) -> [f32; 2] {
    let (side, focal, principal) = (f64::from(side), f64::from(focal), f64::from(principal));
    let margin = f64::from(FRUSTUM_MARGIN) * 0.5 * side / focal;
    [(-principal / focal - margin) as f32, ((side - principal) / focal + margin) as f32]
}

/// The point where the projection is linearised: `(x/z, y/z)` limited to the frustum plus a margin
/// (gsplat), and whether each was inside.
pub fn clamped_ray(params: &Params, p: [f32; 3]) -> ([f32; 2], [bool; 2]) {
    let inverse_z = portable::reciprocal(p[2]);
    let x = p[0] * inverse_z;
    let y = p[1] * inverse_z;
    let [low_x, high_x, low_y, high_y] = params.frustum;
    let inside = [(x >= low_x) & (x <= high_x), (y >= low_y) & (y <= high_y)];
    ([clamp(x, low_x, high_x), clamp(y, low_y, high_y)], inside)
}

/// Rows of `M = J V`: the 2D covariance is `M Mᵀ`. `axes` holds the columns of `V`, the splat's
/// scaled axes in camera coordinates.
pub fn projected_axes(
    params: &Params,
    z: f32,
    ray: [f32; 2],
    axes: &[[f32; 3]; 3],
) -> ([f32; 3], [f32; 3]) {
    let inverse_z = portable::reciprocal(z);
    let sx = params.focal[0] * inverse_z;
    let sy = params.focal[1] * inverse_z;
    let m0 = [
        sx * (axes[0][0] - ray[0] * axes[0][2]),
        sx * (axes[1][0] - ray[0] * axes[1][2]),
        sx * (axes[2][0] - ray[0] * axes[2][2]),
    ];
    let m1 = [
        sy * (axes[0][1] - ray[1] * axes[0][2]),
        sy * (axes[1][1] - ray[1] * axes[1][2]),
        sy * (axes[2][1] - ray[1] * axes[2][2]),
    ];
    (m0, m1)
}

/// Largest component of a splat's projected axes, pixels: an f32 holds its fourth power, with room for derivatives.
pub const WIDE: f32 = 1e6;

/// Least determinant of a covariance, in units of the fourth power of its splat's length. Only needles longer than
/// [`WIDE`] and 1e15 times as long as wide are below; they are not drawn.
pub const THIN: f32 = 1e-30;

/// Longest component of a splat's projected axes.
fn longest(m0: [f32; 3], m1: [f32; 3]) -> f32 {
    let of = |m: [f32; 3]| max(m[0].abs(), max(m[1].abs(), m[2].abs()));
    max(of(m0), of(m1))
}

/// Factor of a splat's projected axes, and of lengths in pixels with them, before any of them is squared. It is 1,
/// except for splats so wide that the covariance's determinant would overflow.
pub fn shrinkage(m0: [f32; 3], m1: [f32; 3]) -> f32 {
    let most = longest(m0, m1);
    if most > WIDE { portable::reciprocal(most) } else { 1.0 }
}

/// `v` times a number.
pub fn scaled(v: [f32; 3], by: f32) -> [f32; 3] {
    [v[0] * by, v[1] * by, v[2] * by]
}

/// Factor `(l11, l21, l22)` of the inverse of a covariance `[[a, b], [b, c]]`.
pub fn conic(b: f32, c: f32, det: f32) -> [f32; 3] {
    let l22 = portable::inverse_sqrt(c);
    let l11 = c * l22 * portable::inverse_sqrt(det);
    [l11, -l11 * b * l22 * l22, l22]
}

/// Determinant of a 2D covariance with a low-pass on its diagonal, from determinant and trace without.
pub fn dilated(det: f32, trace: f32, low_pass: f32) -> f32 {
    det + low_pass * trace + low_pass * low_pass
}

/// Depths, lengths of projected axes in pixels, and means in pixels. Beyond these a splat is culled, so that all
/// results stay within f32, and far from denormals.
const DEPTHS: [f32; 2] = [1e-18, 1e30];
const LONGEST: f32 = 1e30;
const FURTHEST: f32 = 1e15;

/// Projects a splat (Zwicker et al. 2001; Kerbl et al. 2023).
///
/// The determinant comes as `|m0 × m1|² + 0.3 tr + 0.09` (Cauchy–Binet), and the conic as its
/// triangular factor: neither cancels, however thin the splat. Splats too wide for f32 are projected
/// at a smaller scale: see [`shrinkage`].
pub fn project(params: &Params, p: [f32; 3], axes: &[[f32; 3]; 3], opacity: f32) -> Projected {
    let [nearest, farthest] = DEPTHS;
    if !((p[2] > params.near) & (p[2] > nearest) & (p[2] < farthest)) {
        return Projected::CULLED;
    }
    let (ray, _) = clamped_ray(params, p);
    let (m0, m1) = projected_axes(params, p[2], ray, axes);
    if !(longest(m0, m1) < LONGEST) {
        return Projected::CULLED;
    }
    let s = shrinkage(m0, m1);
    let (m0, m1) = (scaled(m0, s), scaled(m1, s));
    let (a0, b, c0) = (dot(m0, m0), dot(m0, m1), dot(m1, m1));
    let low_pass = params.dilation * s * s;
    let (a, c) = (a0 + low_pass, c0 + low_pass);
    let minors = cross(m0, m1);
    let det0 = dot(minors, minors);
    let det = dilated(det0, a0 + c0, low_pass);
    if !(det > THIN) {
        return Projected::CULLED;
    }
    let mut alpha = opacity;
    if params.dilation_kept < params.dilation {
        let kept = dilated(det0, a0 + c0, params.dilation_kept * s * s);
        alpha *= portable::sqrt(max(kept * portable::reciprocal(det), RATIO_MIN));
    }
    let inverse_z = portable::reciprocal(p[2]);
    let mean = [
        params.focal[0] * p[0] * inverse_z + params.principal[0],
        params.focal[1] * p[1] * inverse_z + params.principal[1],
    ];
    let shown = (alpha >= ALPHA_MIN) & (mean[0].abs() < FURTHEST) & (mean[1].abs() < FURTHEST);
    if !shown {
        return Projected::CULLED;
    }
    let grown = portable::reciprocal(s);
    Projected {
        mean,
        conic: scaled(conic(b, c, det), s),
        sigma: [portable::sqrt(a) * grown, portable::sqrt(c) * grown],
        log_opacity: portable::log2(alpha),
        depth: p[2],
    }
}

/// The squared distance, in standard deviations, at which alpha reaches [`ALPHA_MIN`].
fn cut(log_opacity: f32) -> f32 {
    2.0 * core::f32::consts::LN_2 * (log_opacity - LOG_ALPHA_MIN)
}

/// Drawn tiles `[x0, y0, x1, y1)` that the splat's bounding box touches; empty if it misses all of them.
/// Every limit is applied in floating point, before the conversion to integers.
pub fn tile_box(params: &Params, s: &Projected) -> [u32; 4] {
    // Rounding may not leave a tile out that has a pixel in it.
    let k = portable::sqrt(cut(s.log_opacity)) * 1.000_01;
    let tiles = [params.tiles_x as f32, params.picture_rows() as f32];
    const SCALE: f32 = 1.0 / TILE as f32;
    // A pixel's index lies half a pixel before its centre, and a far mean is rounded.
    let ex = k * s.sigma[0] + 0.51 + 1e-6 * s.mean[0].abs();
    let ey = k * s.sigma[1] + 0.51 + 1e-6 * s.mean[1].abs();
    [
        clamp(((s.mean[0] - ex) * SCALE).floor(), 0.0, tiles[0]) as u32,
        params.drawn_before(clamp(((s.mean[1] - ey) * SCALE).floor(), 0.0, tiles[1]) as u32),
        clamp(((s.mean[0] + ex) * SCALE).floor() + 1.0, 0.0, tiles[0]) as u32,
        params.drawn_before(clamp(((s.mean[1] + ey) * SCALE).floor() + 1.0, 0.0, tiles[1]) as u32),
    ]
}

/// The outline at which a splat reaches [`ALPHA_MIN`]: the ellipse `q ≤ cut`. Its tiles are found row by row.
#[derive(Clone, Copy)]
pub struct Outline {
    /// Mean, pixels.
    pub mean: [f32; 2],
    /// The middle of the ellipse at height y is `slope · y`, from the mean.
    pub slope: f32,
    /// Half its width there is `√(cut − (rise y)²) · width`.
    pub rise: f32,
    /// See `rise`.
    pub width: f32,
    /// Largest `q` that counts.
    pub cut: f32,
    /// Height of its rightmost point; that of the leftmost is the opposite.
    pub tip: f32,
}

impl Outline {
    /// The cut has a margin for rounding, here and in blending: stage `splat` must not find a pixel inside whose tile
    /// is not in the list.
    pub fn new(params: &Params, s: &Projected) -> Outline {
        let [l11, l21, l22] = s.conic;
        // The factor's two components are sums of products of this size.
        let across = s.mean[0].abs() + (params.tiles_x * TILE) as f32;
        let down = s.mean[1].abs() + (params.picture_rows() * TILE) as f32;
        let slack = 5e-7 * (l11 * across + (l21.abs() + l22) * down);
        let cut = cut(s.log_opacity) * 1.001 + 1e-2 + slack * (8.0 + slack);
        let slope = -l21 / l11;
        // With Σ = Q⁻¹: Σyy = 1/l22², Σxy = slope · Σyy, Σxx = 1/l11² + slope · Σxy.
        let (yy, width) = (1.0 / (l22 * l22), 1.0 / l11);
        let xx = width * width + slope * slope * yy;
        Outline { mean: s.mean, slope, rise: l22, width, cut, tip: slope * yy * (cut / xx).sqrt() }
    }

    /// Drawn rows of tiles `[first, end)` that have a pixel centre at the ellipse's height.
    pub fn rows(&self, params: &Params) -> [u32; 2] {
        let height = self.cut.sqrt() / self.rise;
        let slack = 1e-6 * self.mean[1].abs();
        let (low, high) = (self.mean[1] - height - slack, self.mean[1] + height + slack);
        let [first, end] = tiles_between(low, high, params.picture_rows());
        [params.drawn_before(first), params.drawn_before(end)]
    }

    /// Tiles `[first, end)` of `count` in the picture's row `row` that have a point of the ellipse between their
    /// outermost pixel centres.
    pub fn columns(&self, row: u32, count: u32) -> [u32; 2] {
        let low = (row * TILE) as i32 as f32 + 0.5 - self.mean[1];
        let high = low + (TILE - 1) as f32;
        // The half width is concave in y: the furthest point is the tip, or the nearest to it.
        let (right, left) = (clamp(self.tip, low, high), clamp(-self.tip, low, high));
        let half = |y: f32| {
            let rest = self.cut - self.rise * y * self.rise * y;
            max(rest, 0.0).sqrt() * self.width
        };
        let middle = self.mean[0];
        let (left, right) = ([self.slope * left, half(left)], [self.slope * right, half(right)]);
        let slack = |[along, half]: [f32; 2]| 1e-6 * (middle.abs() + along.abs() + half);
        let first = middle + left[0] - left[1] - slack(left);
        tiles_between(first, middle + right[0] + right[1] + slack(right), count)
    }
}

/// Tiles `[first, end)` of `count` along an axis whose span of pixel centres meets `[low, high]`.
pub fn tiles_between(low: f32, high: f32, count: u32) -> [u32; 2] {
    let scale = 1.0 / TILE as f32;
    let limit = count as f32;
    let first = clamp(((low - (TILE as f32 - 0.5)) * scale).ceil(), 0.0, limit);
    let end = clamp(((high - 0.5) * scale).floor() + 1.0, first, limit);
    // Signed conversions are one instruction on a CPU's vectors, unsigned ones several.
    [first as i32 as u32, end as i32 as u32]
}

/// The sort's keys come to blocks by multiples of this: of the invocations of every workgroup that goes through one.
pub const SORT_STEP: u32 = 128;

/// Items `[first, end)` of workgroup `block`. 2^`log_blocks` workgroups share `count` items evenly, in multiples of
/// `step`.
pub fn block(count: u32, log_blocks: u32, block: u32, step: u32) -> [u32; 2] {
    let each = ((count >> (log_blocks & 31)) / step + 1) * step;
    let first = block * each;
    let end = first + each;
    [if first < count { first } else { count }, if end < count { end } else { count }]
}

/// The depth key that no splat exceeds, from the camera's place and the prior's radius.
pub fn largest_key(params: &Params) -> u32 {
    let [x, y, z] = params.translation;
    let (radius, [_, farthest]) = (params.radius, DEPTHS);
    // The last term is far more than the rounding of a depth.
    let far = z + radius + 1e-5 * (x.abs() + y.abs() + z.abs() + radius);
    // One that is not a number gives the farthest.
    let far = if far < farthest { far } else { farthest };
    if far > params.near { far.to_bits() - params.near.to_bits() } else { 0 }
}

/// Bits of a digit, so that [`DIGITS`] digits hold a key; at least 5, so that the digits fill every
/// workgroup.
pub fn digit_bits(largest_key: u32) -> u32 {
    let bits = (u32::BITS - largest_key.leading_zeros()).div_ceil(DIGITS);
    if bits > 5 { bits } else { 5 }
}

/// The sum, or the largest number if it would wrap. So the host learns of too many pairs, not of a
/// few.
pub fn saturating(a: u32, b: u32) -> u32 {
    let sum = a.wrapping_add(b);
    if sum < a { u32::MAX } else { sum }
}

/// Number of coefficients of a degree.
pub const fn sh_coefficients(degree: u32) -> u32 {
    (degree + 1) * (degree + 1)
}

/// Planes of the `sh` buffer, of a pair of floats per splat: two coefficients are three planes.
pub const fn sh_planes(degree: u32) -> u32 {
    3 * sh_coefficients(degree).div_ceil(2)
}

/// Real spherical harmonics at the unit direction `d`, degrees 0–3, signs and constants as Inria's.
pub fn sh_basis(d: [f32; 3]) -> [f32; 16] {
    let (x, y, z) = (d[0], d[1], d[2]);
    let (xx, yy, zz) = (x * x, y * y, z * z);
    [
        0.282_094_8,
        -0.488_602_52 * y,
        0.488_602_52 * z,
        -0.488_602_52 * x,
        1.092_548_5 * x * y,
        -1.092_548_5 * y * z,
        0.315_391_57 * (2.0 * zz - xx - yy),
        -1.092_548_5 * x * z,
        0.546_274_24 * (xx - yy),
        -0.590_043_6 * y * (3.0 * xx - yy),
        2.890_611_4 * x * y * z,
        -0.457_045_8 * y * (4.0 * zz - xx - yy),
        0.373_176_34 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        -0.457_045_8 * x * (4.0 * zz - xx - yy),
        1.445_305_7 * z * (xx - yy),
        -0.590_043_6 * x * (xx - 3.0 * yy),
    ]
}

/// The unit direction from the camera's centre to a point, and one over the distance.
pub fn direction(params: &Params, position: [f32; 3]) -> ([f32; 3], f32) {
    let v = [
        position[0] - params.centre[0],
        position[1] - params.centre[1],
        position[2] - params.centre[2],
    ];
    // Beyond 1e18 the square of a distance is beyond f32.
    let s = if longest(v, v) < 1e18 { 1.0 } else { 1e-20 };
    let v = scaled(v, s);
    let inverse = portable::inverse_sqrt(max(dot(v, v), 1e-36));
    let d = scaled(v, inverse);
    // Products of three of them stay far from denormals.
    let whole = |v: f32| if v.abs() > 1e-12 { v } else { 0.0 };
    ([whole(d[0]), whole(d[1]), whole(d[2])], inverse * s)
}

/// Gradients of [`sh_basis`] with respect to `d`, taken as free coordinates.
pub fn sh_basis_gradient(d: [f32; 3]) -> [[f32; 3]; 16] {
    let (x, y, z) = (d[0], d[1], d[2]);
    let (xx, yy, zz) = (x * x, y * y, z * z);
    let (c1, c2, c3) = (0.488_602_52, 1.092_548_5, 0.315_391_57);
    let (c5, c6, c7, c8) = (0.590_043_6, 2.890_611_4, 0.457_045_8, 0.373_176_34);
    [
        [0.0, 0.0, 0.0],
        [0.0, -c1, 0.0],
        [0.0, 0.0, c1],
        [-c1, 0.0, 0.0],
        [c2 * y, c2 * x, 0.0],
        [0.0, -c2 * z, -c2 * y],
        [-2.0 * c3 * x, -2.0 * c3 * y, 4.0 * c3 * z],
        [-c2 * z, 0.0, -c2 * x],
        [c2 * x, -c2 * y, 0.0],
        [-6.0 * c5 * x * y, -3.0 * c5 * (xx - yy), 0.0],
        [c6 * y * z, c6 * x * z, c6 * x * y],
        [2.0 * c7 * x * y, -c7 * (4.0 * zz - xx - 3.0 * yy), -8.0 * c7 * y * z],
        [-6.0 * c8 * x * z, -6.0 * c8 * y * z, 3.0 * c8 * (2.0 * zz - xx - yy)],
        [-c7 * (4.0 * zz - 3.0 * xx - yy), 2.0 * c7 * x * y, -8.0 * c7 * x * z],
        [c6 * x * z, -c6 * y * z, 0.5 * c6 * (xx - yy)],
        [-3.0 * c5 * (xx - yy), 6.0 * c5 * x * y, 0.0],
    ]
}
