//! Counts of a picture's work, from which the cost of its stages follows.

use std::ops::Range;

use nvsprior::{Camera, Prior};
use nvsprior_kernels::shared::{
    ALPHA_MIN, Outline, Params, Projected, TILE, TRANSMITTANCE_STOP, sh_coefficients, sh_planes,
};
use nvsprior_reference::probe::Stages;

/// The amounts of a render at one pose.
#[derive(Clone, Copy, Debug, Default)]
pub struct Counts {
    /// Splats of the prior, N.
    pub splats: f64,
    /// Those that touch a tile, V.
    pub visible: f64,
    /// Coefficients of the spherical harmonics, for each channel, H.
    pub coefficients: f64,
    /// Pairs of floats that hold a splat's harmonics.
    pub planes: f64,
    /// Splats times the tiles that they touch, P.
    pub pairs: f64,
    /// Splats times the rows of tiles that they touch, R.
    pub rows: f64,
    /// Splats times pixels that are blended, in a picture and in an evaluation, E.
    pub blended: [f64; 2],
    /// Tiles, T.
    pub tiles: f64,
    /// Tiles of a row.
    pub tiles_x: f64,
    /// Pixels, X.
    pub pixels: f64,
    /// Pixels of the frame, whatever the level.
    pub frame_pixels: f64,
    /// Values of a digit, D.
    pub digits: f64,
}

impl Counts {
    /// Counts a prior's render that left `stages`, if only one of 2^`row_shift` rows of tiles were drawn. `camera` is
    /// the level's, `frame` that of the full picture.
    pub fn of(
        prior: &Prior,
        camera: &Camera,
        frame: &Camera,
        stages: &Stages,
        row_shift: u32,
    ) -> Counts {
        let view = Tiles::of(prior, camera, stages, row_shift);
        let (across, down) = (view.params.tiles_x, view.params.tiles_y);
        let rows = view.rows();
        let degree = prior.splats().sh_degree;
        Counts {
            splats: prior.splats().len() as f64,
            visible: rows.iter().filter(|rows| **rows > 0).count() as f64,
            coefficients: f64::from(sh_coefficients(degree)),
            planes: f64::from(sh_planes(degree)),
            pairs: view.pairs(),
            rows: rows.iter().copied().map(f64::from).sum(),
            blended: [view.blended(TILE), view.blended(TILE / 2)],
            tiles: f64::from(across * down),
            tiles_x: f64::from(across),
            pixels: f64::from(camera.width * view.pixel_rows()),
            frame_pixels: frame.pixels() as f64,
            digits: f64::from(1 << stages.digit_bits),
        }
    }
}

/// A picture's drawn tiles with their lists.
struct Tiles<'a> {
    stages: &'a Stages,
    camera: &'a Camera,
    params: Params,
    alpha_max: f32,
}

impl Tiles<'_> {
    fn of<'a>(prior: &Prior, camera: &'a Camera, stages: &'a Stages, row_shift: u32) -> Tiles<'a> {
        let (height, tiles_x) = (camera.height, camera.width.div_ceil(TILE));
        let params = Params { height, tiles_x, ..Params::default() }.with_rows(row_shift);
        Tiles { stages, camera, params, alpha_max: prior.options().alpha_max }
    }

    /// Drawn rows of pixels.
    fn pixel_rows(&self) -> u32 {
        (0..self.camera.height).filter(|y| self.params.draws(y / TILE)).count() as u32
    }

    /// Rows of tiles that each splat touches, in the order of their depths.
    fn rows(&self) -> Vec<u32> {
        let rows = |splat: &u32| {
            let r = &self.stages.records[*splat as usize];
            let (mean, conic) = ([r[0], r[1]], [r[2], r[3], r[4]]);
            let splat = Projected { mean, conic, log_opacity: r[5], ..Projected::CULLED };
            let [top, bottom] = Outline::new(&self.params, &splat).rows(&self.params);
            bottom - top
        };
        self.stages.order.iter().map(rows).collect()
    }

    /// The first pixel of each drawn tile, and its list in the whole picture.
    fn lists(&self) -> impl Iterator<Item = ([u32; 2], [u32; 2])> {
        let across = self.params.tiles_x;
        let rows = (0..self.params.tiles_y).map(|row| self.params.tile_row(row));
        rows.flat_map(move |y| (0..across).map(move |x| [x, y])).map(move |[x, y]| {
            ([x * TILE, y * TILE], self.stages.ranges[(y * across + x) as usize])
        })
    }

    /// Splats times the drawn tiles that they touch.
    fn pairs(&self) -> f64 {
        self.lists().map(|(_, [first, end])| f64::from(end - first)).sum()
    }

    /// Splats times pixels that the blending goes through if it takes `rows` rows of a tile at a time, and stops when
    /// all of their pixels are finished.
    fn blended(&self, rows: u32) -> f64 {
        let mut drawn = 0;
        for (corner, range) in self.lists() {
            let parts = (0..TILE).step_by(rows as usize);
            drawn += parts.map(|top| self.drawn(corner, top..top + rows, range)).sum::<usize>();
        }
        drawn as f64 * f64::from(TILE * rows)
    }

    /// Splats that are drawn in some rows of the tile at a corner.
    fn drawn(&self, corner: [u32; 2], rows: Range<u32>, [from, to]: [u32; 2]) -> usize {
        let pixels = rows.flat_map(|y| (0..TILE).map(move |x| [corner[0] + x, corner[1] + y]));
        let inside = |p: &[u32; 2]| p[0] < self.camera.width && p[1] < self.camera.height;
        let mut left: Vec<([f32; 2], f32)> =
            pixels.filter(inside).map(|p| (p.map(|v| v as f32 + 0.5), 1.0)).collect();
        let list = self.stages.pair_splats.get(from as usize..to as usize).unwrap_or_default();
        let ends = |splat: &u32| {
            dim(&mut left, &self.stages.records[*splat as usize], self.alpha_max);
            left.iter().all(|(_, t)| *t == 0.0)
        };
        list.iter().position(ends).map_or(list.len(), |last| last + 1)
    }
}

/// Dims the transmittance of some pixels, each with its centre, by a splat; 0: finished.
fn dim(left: &mut [([f32; 2], f32)], record: &[f32; 12], alpha_max: f32) {
    let [u, v, l11, l21, l22, log_opacity, ..] = *record;
    let opacity = log_opacity.exp2();
    for ([x, y], t) in left {
        let (dx, dy) = (u - *x, v - *y);
        let (a, b) = (l11 * dx + l21 * dy, l22 * dy);
        let alpha = (opacity * (-0.5 * (a * a + b * b)).exp()).min(alpha_max);
        let after = *t * if alpha < ALPHA_MIN { 1.0 } else { 1.0 - alpha };
        *t = if after > TRANSMITTANCE_STOP { after } else { 0.0 };
    }
}
