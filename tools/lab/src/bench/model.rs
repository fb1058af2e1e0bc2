//! How many bytes and floating-point operations each stage should take, counted from its source.
//!
//! Bytes are those of the algorithm: each word that an invocation asks for counts, caches or not,
//! but words that a workgroup shares count once. Operations are sums, products, divisions, roots,
//! minima, and comparisons that choose a value; a power of e is 14. Integer work is not counted. All
//! of it is counted by hand: estimates, closest for the blending.

use nvsprior::render::probe::Stages;
use nvsprior::{Camera, Prior};
use nvsprior_kernels::shared::{
    CULLED, DIGITS, TABLE, TILE, band_rows, digit_bits, sh_coefficients, sh_planes,
};

/// What a picture is made of.
#[derive(Clone, Copy, Debug)]
pub struct Counts {
    /// Splats of the prior.
    pub splats: f64,
    /// Those that touch a tile.
    pub visible: f64,
    /// Of a splat and a tile that it touches.
    pub pairs: f64,
    /// Those that the blending goes through: a tile ends with its last pixel.
    pub drawn: f64,
    pub tiles: f64,
    pub pixels: f64,
    /// Pixels of the frame, whatever the level.
    frame_pixels: f64,
    /// Coefficients of a splat, and pairs of floats that hold them.
    coefficients: f64,
    planes: f64,
    /// Values of a digit times blocks of the sort.
    histogram: f64,
    /// Tiles times blocks of the binning.
    table: f64,
    bands: f64,
}

impl Counts {
    /// `camera` is a level's, `frame` that of the full picture; `cpu`: what kind the device is.
    pub fn of(
        prior: &Prior,
        camera: &Camera,
        frame: &Camera,
        stages: &Stages,
        cpu: bool,
    ) -> Counts {
        let [across, down] = [camera.width, camera.height].map(|side| side.div_ceil(TILE));
        let tiles = across * down;
        let (splats, degree) = (prior.splats().len(), prior.splats().sh_degree);
        let largest = stages.keys.iter().filter(|key| **key != CULLED).max();
        // Workgroups that share a pass, as the renderer has them.
        let least = if cpu { 4 } else { 7 };
        let blocks = f64::from((splats as u32 / 4096).max(1).ilog2().clamp(least, 8)).exp2();
        Counts {
            splats: splats as f64,
            visible: stages.order.len() as f64,
            pairs: f64::from(stages.pairs_needed),
            drawn: drawn(prior, camera, across, stages) as f64,
            tiles: f64::from(tiles),
            pixels: camera.pixels() as f64,
            frame_pixels: frame.pixels() as f64,
            coefficients: f64::from(sh_coefficients(degree)),
            planes: f64::from(sh_planes(degree)),
            histogram: blocks * f64::from(TABLE.min(1 << digit_bits(*largest.unwrap_or(&0)))),
            table: blocks * f64::from(tiles),
            bands: f64::from(down.div_ceil(band_rows(across))),
        }
    }

    /// Splats times pixels that the blending goes through.
    pub fn blended(&self) -> f64 {
        self.drawn * f64::from(TILE * TILE)
    }
}

/// Pairs that the blending goes through.
fn drawn(prior: &Prior, camera: &Camera, across: u32, stages: &Stages) -> usize {
    let alpha_max = prior.options().alpha_max;
    let in_tile = |(tile, &[from, to]): (u32, &[u32; 2])| {
        let corner = [(tile % across * TILE) as f32, (tile / across * TILE) as f32];
        let list = stages.pair_splats.get(from as usize..to as usize).unwrap_or_default();
        let mut left = [1.0f32; (TILE * TILE) as usize];
        for (k, left) in left.iter_mut().enumerate() {
            let at = [corner[0] + (k as u32 % TILE) as f32, corner[1] + (k as u32 / TILE) as f32];
            let inside = at[0] < camera.width as f32 && at[1] < camera.height as f32;
            *left = if inside { 1.0 } else { 0.0 };
        }
        let ends = |splat: &u32| {
            dim(&mut left, &stages.records[*splat as usize], corner, alpha_max);
            left.iter().all(|t| *t == 0.0)
        };
        list.iter().position(ends).map_or(list.len(), |last| last + 1)
    };
    (0..).zip(&stages.ranges).map(in_tile).sum()
}

/// What a splat leaves of the transmittance of a tile's pixels; 0: finished.
fn dim(left: &mut [f32], s: &[f32; 12], corner: [f32; 2], alpha_max: f32) {
    for (k, t) in (0..).zip(left.iter_mut()) {
        let dx = s[0] - corner[0] - (k % TILE) as f32 - 0.5;
        let dy = s[1] - corner[1] - (k / TILE) as f32 - 0.5;
        let (u, w) = (s[2] * dx + s[3] * dy, s[4] * dy);
        let alpha = (s[5] * (-0.5 * (u * u + w * w)).exp()).min(alpha_max);
        let alpha = if alpha < 1.0 / 255.0 { 0.0 } else { alpha };
        *t = if *t * (1.0 - alpha) > 1e-4 { *t * (1.0 - alpha) } else { 0.0 };
    }
}

/// What a stage takes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Work {
    pub bytes: f64,
    pub flops: f64,
}

impl std::ops::AddAssign for Work {
    fn add_assign(&mut self, other: Work) {
        self.bytes += other.bytes;
        self.flops += other.flops;
    }
}

impl std::ops::Mul<f64> for Work {
    type Output = Work;

    fn mul(self, times: f64) -> Work {
        Work { bytes: self.bytes * times, flops: self.flops * times }
    }
}

/// Operations of one splat at one pixel: the exponent 4, its power 14, alpha 2, the weights 4,
/// colour and depth 8.
const PICTURE: f64 = 4.0 + 14.0 + 2.0 + 4.0 + 8.0;
/// Without depth; the pull 6, the step of the weights 14, the twelve sums 24, the transmittance's
/// 4.
const FLOW: f64 = PICTURE - 2.0 + 6.0 + 14.0 + 24.0 + 4.0;
/// Without depth; `v` 5, dα of six derivatives with six terms each 72, weights 18, three colours 54
/// with their own derivatives, the transmittance 18.
const EXACT: f64 = PICTURE - 2.0 + 5.0 + 72.0 + 18.0 + 54.0 + 18.0;
/// Of a pixel's share of the normal equations: three channels with 27 multiply-adds and about 40
/// more.
const ADD: f64 = 3.0 * (2.0 * 27.0 + 40.0);
/// Sums of the normal equations.
const SUMS: f64 = 28.0;

/// Work of a stage of this name at a picture's counts; `digits` are those of its sort. Stages that
/// touch some hundred bytes count as nothing.
pub fn work(stage: &str, c: &Counts, digits: u32) -> Work {
    let (n, v, p) = (c.splats, c.visible, c.pairs);
    let later = f64::from(digits) - 1.0;
    let passes = f64::from(digits);
    let of = |bytes: f64, flops: f64| Work { bytes, flops };
    match stage {
        // Seven pairs per splat; of those seen the harmonics; a record and a key.
        "project" => of(
            n * (7.0 * 8.0 + 4.0) + v * (8.0 * c.planes + 48.0),
            n * 190.0 + v * (52.0 + 6.0 * c.coefficients),
        ),
        "radix_count" => of(4.0 * (n + later * v + passes * c.histogram), 0.0),
        // Read twice, written once.
        "radix_scan" => of(12.0 * passes * c.histogram, 0.0),
        // The first pass makes its values.
        "radix_scatter" => {
            of(4.0 * n + 8.0 * v + later * 16.0 * v + 4.0 * passes * c.histogram, 0.0)
        }
        // Each band goes over all: place in the order, two thirds of a record.
        "bin_count" => of(c.bands * 36.0 * v + 4.0 * c.table, c.bands * 40.0 * v + 20.0 * p),
        "bin_scan" => of(12.0 * c.table, 0.0),
        "bin_emit" => {
            let written = 4.0 * p + 8.0 * c.tiles;
            of(c.bands * 36.0 * v + 4.0 * c.table + written, c.bands * 40.0 * v + 20.0 * p)
        }
        // An entry of the list and a record; five floats per pixel.
        "splat" => of(52.0 * c.drawn + 8.0 * c.tiles + 20.0 * c.pixels, PICTURE * c.blended()),
        "splat_flow" => of(
            52.0 * c.drawn + (8.0 + 4.0 * SUMS) * c.tiles + 12.0 * c.pixels,
            FLOW * c.blended() + ADD * c.pixels,
        ),
        // Twelve vectors of derivatives a record.
        "splat_exact" => of(
            (52.0 + 192.0) * c.drawn + (8.0 + 4.0 * SUMS) * c.tiles + 12.0 * c.pixels,
            EXACT * c.blended() + ADD * c.pixels,
        ),
        "pose_jacobian" => of(
            4.0 * n + v * (7.0 * 8.0 + 8.0 * c.planes + 48.0 + 192.0),
            v * (700.0 + 24.0 * c.coefficients),
        ),
        "reduce" | "solve" => of(4.0 * SUMS * c.tiles, SUMS * c.tiles),
        // Bytes of the whole frame, whatever the level; floats of the level.
        "pyramid" => of(3.0 * c.frame_pixels + 12.0 * c.pixels, 3.0 * c.frame_pixels),
        "quantize_rgb8" => of((20.0 + 3.0) * c.pixels, 12.0 * c.pixels),
        "difference" => of(9.0 * c.pixels, 0.0),
        _ => Work::default(),
    }
}

/// Digits of a picture's sort, and of that of an evaluation nobody sees.
pub const PICTURE_DIGITS: u32 = DIGITS;
/// See [`PICTURE_DIGITS`].
pub const SEARCH_DIGITS: u32 = DIGITS - 1;
