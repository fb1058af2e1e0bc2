//! Stages `ssim_rows`, `ssim_columns`, `ssim_back`, `ssim_gradient`, `loss_gradient`: the gradient of the training loss
//! by each pixel of the render, `(1 − s) h(render − frame) + s (1 − SSIM)`, means over pixels and channels (Kerbl et
//! al. 2023, eq. 7; SSIM of Wang et al. 2004). `h(d)` is the absolute value less half the knee, below the knee
//! `d² / (2 knee)` (Huber 1964). The window is separable: rows, then columns. Beyond the picture all is zero, as are
//! pixels that do not count, in render and frame.
//!
//! An invocation blurs [`RUN`] pixels in a row or column, so that each value is loaded 2.25 times, not 11 times:
//! docs/decisions.md, 8.

use crate::memory::{Pairs, PairsMut, at, at_mut};
use crate::shared::{PIXEL, Params, max, min};
use crate::training::{
    FRAME_BITS, FRAME_COUNTS, FRAME_MASK, FRAME_ONE, GRADIENT_PIXEL, RUN, SSIM_REACH, SSIM_WEIGHTS,
    Training,
};
use spirv_std::glam::{UVec3, Vec4};
use spirv_std::spirv;

/// Stabilise quotients of small numbers, for values in [0, 1].
const C1: f32 = 0.01 * 0.01;
const C2: f32 = 0.03 * 0.03;

/// Values that a run of pixels is blurred from.
const TAPS: usize = (RUN + 2 * SSIM_REACH) as usize;

/// Values that lie one after the other along a row or a column.
type Line = [f32; TAPS];
/// A blurred run.
type Blurred = [Vec4; 2];

const _: () = assert!(RUN == 8 && TAPS == 18);

/// An array of an expression of `$k`, 0 to 17: indices must be constants.
macro_rules! line {
    ($k:ident => $value:expr) => {
        line!($k => $value; 0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17)
    };
    ($k:ident => $value:expr; $($index:literal)+) => {
        [$({ let $k: u32 = $index; $value }),+]
    };
}

/// The weights of a value for each pixel of a run.
struct Tap<const K: usize>;

impl<const K: usize> Tap<K> {
    const WEIGHTS: [f32; RUN as usize] = {
        let mut weights = [0.0; RUN as usize];
        let mut pixel = 0;
        while pixel < RUN as usize {
            let away = (K as isize - (pixel as isize + SSIM_REACH as isize)).unsigned_abs();
            if away <= SSIM_REACH as usize {
                weights[pixel] = SSIM_WEIGHTS[away];
            }
            pixel += 1;
        }
        weights
    };

    fn add([upper, lower]: Blurred, line: &Line) -> Blurred {
        let [a, b, c, d, e, f, g, h] = Self::WEIGHTS;
        let value = line[K];
        [upper + Vec4::new(a, b, c, d) * value, lower + Vec4::new(e, f, g, h) * value]
    }
}

/// Blurs a run.
fn blurred(line: &Line) -> Blurred {
    let mut sums = [Vec4::ZERO; 2];
    sums = Tap::<0>::add(sums, line);
    sums = Tap::<1>::add(sums, line);
    sums = Tap::<2>::add(sums, line);
    sums = Tap::<3>::add(sums, line);
    sums = Tap::<4>::add(sums, line);
    sums = Tap::<5>::add(sums, line);
    sums = Tap::<6>::add(sums, line);
    sums = Tap::<7>::add(sums, line);
    sums = Tap::<8>::add(sums, line);
    sums = Tap::<9>::add(sums, line);
    sums = Tap::<10>::add(sums, line);
    sums = Tap::<11>::add(sums, line);
    sums = Tap::<12>::add(sums, line);
    sums = Tap::<13>::add(sums, line);
    sums = Tap::<14>::add(sums, line);
    sums = Tap::<15>::add(sums, line);
    sums = Tap::<16>::add(sums, line);
    Tap::<17>::add(sums, line)
}

/// A channel of the frame's pixel.
fn frame_at(pixel: u32, channel: u32) -> f32 {
    (pixel >> (FRAME_BITS * channel) & FRAME_MASK) as f32 * (1.0 / FRAME_ONE as f32)
}

/// A channel of the render's pixel; 0 if the frame's does not count.
fn render_at(image: &[f32], pixel: u32, channel: u32, of_frame: u32) -> f32 {
    let value = at(image, pixel * PIXEL + channel);
    if of_frame & FRAME_COUNTS != 0 { value } else { 0.0 }
}

/// Does something for each pixel of a run, and its values in two blurred runs.
macro_rules! each_of_run {
    ($k:ident, $a:ident = $of_a:expr, $b:ident = $of_b:expr => $body:block) => {
        let ([a, c], [b, d]) = ($of_a, $of_b);
        each_of_run!($k $a $b $body; 0 a.x b.x, 1 a.y b.y, 2 a.z b.z, 3 a.w b.w,
            4 c.x d.x, 5 c.y d.y, 6 c.z d.z, 7 c.w d.w);
    };
    ($k:ident $a:ident $b:ident $body:block; $($index:literal $va:ident . $ca:ident $vb:ident . $cb:ident),+) => {
        $({ let ($k, $a, $b): (u32, f32, f32) = ($index, $va.$ca, $vb.$cb); $body })+
    };
}

/// A run of pixels of one channel: along a row for invocations by rows, else along a column.
#[derive(Clone, Copy)]
struct Run {
    /// The run's first pixel, along it and across.
    along: u32,
    across: u32,
    /// Pixels along it and across, in the picture.
    length: u32,
    breadth: u32,
    /// From one pixel to the next.
    step: u32,
    /// From one row, or column, to the next.
    stride: u32,
    channel: u32,
}

impl Run {
    /// By rows: one invocation per row (x) and run of columns (y). Those beyond the last row do its work again: if they
    /// ended, all that follows would be masked.
    fn of_row(params: &Params, id: UVec3) -> Run {
        let (length, breadth) = (params.width, params.height);
        let (along, across) = (id.y * RUN, min_u32(id.x, breadth - 1));
        Run { along, across, length, breadth, step: 1, stride: params.width, channel: id.z }
    }

    /// By columns: one invocation per column (x) and run of rows (y).
    fn of_column(params: &Params, id: UVec3) -> Run {
        let (length, breadth) = (params.height, params.width);
        let (along, across) = (id.y * RUN, min_u32(id.x, breadth - 1));
        Run { along, across, length, breadth, step: params.width, stride: 1, channel: id.z }
    }

    /// The pixel of a tap, and whether it lies in the picture. If not, another pixel is given.
    fn tap(self, k: u32) -> (u32, bool) {
        // Before the first pixel the number wraps, and is too large.
        let along = (self.along + k).wrapping_sub(SSIM_REACH);
        let inside = along < self.length;
        (self.across * self.stride + if inside { along } else { 0 } * self.step, inside)
    }

    /// Where a map of the channel begins.
    fn map(self, map: u32) -> u32 {
        (map * 3 + self.channel) * self.length * self.breadth
    }

    /// Two maps along the run, blurred.
    fn blurred_pair<M: Pairs + ?Sized>(self, maps: &M, map: u32) -> [Blurred; 2] {
        let first = self.map(map);
        let pairs = line!(k => {
            let (pixel, inside) = self.tap(k);
            let pair = maps.pair(first + pixel);
            if inside { pair } else { [0.0; 2] }
        });
        [blurred(&line!(k => pairs[k as usize][0])), blurred(&line!(k => pairs[k as usize][1]))]
    }

    /// A map along the run, blurred.
    fn blurred(self, maps: &[f32], map: u32) -> Blurred {
        let first = self.map(map);
        let line = line!(k => {
            let (pixel, inside) = self.tap(k);
            let value: f32 = at(maps, first + pixel);
            if inside { value } else { 0.0 }
        });
        blurred(&line)
    }

    /// Writes a run to two maps.
    fn store_pair<M: PairsMut + ?Sized>(self, maps: &mut M, map: u32, [a, b]: [Blurred; 2]) {
        let first = self.map(map);
        each_of_run!(k, value_a = a, value_b = b => {
            let (pixel, inside) = self.tap(k + SSIM_REACH);
            if inside {
                maps.put(first + pixel, [value_a, value_b]);
            }
        });
    }

    /// Writes a run to a map.
    fn store(self, maps: &mut [f32], map: u32, a: Blurred) {
        let first = self.map(map);
        each_of_run!(k, value = a, _other = a => {
            let (pixel, inside) = self.tap(k + SSIM_REACH);
            if inside {
                *at_mut(maps, first + pixel) = value;
            }
        });
    }
}

fn min_u32(a: u32, b: u32) -> u32 {
    if a < b { a } else { b }
}

/// Blurs along rows.
fn rows<M: PairsMut + ?Sized>(
    params: &Params,
    image: &[f32],
    frame: &[u32],
    maps: &mut M,
    id: UVec3,
) {
    let run = Run::of_row(params, id);
    let pixels = line!(k => {
        let (pixel, inside) = run.tap(k);
        let value: u32 = at(frame, pixel);
        if inside { value } else { 0 }
    });
    let x = line!(k => render_at(image, run.tap(k).0, run.channel, pixels[k as usize]));
    let y = line!(k => frame_at(pixels[k as usize], run.channel));
    run.store_pair(maps, 0, [blurred(&x), blurred(&y)]);
    let squares = line!(k => x[k as usize] * x[k as usize] + y[k as usize] * y[k as usize]);
    let products = line!(k => x[k as usize] * y[k as usize]);
    run.store_pair(maps, 1, [blurred(&squares), blurred(&products)]);
}

/// SSIM's derivatives at four pixels, by the render's mean, its variance and the covariance, from blurred maps.
fn partials_of(mean_x: Vec4, mean_y: Vec4, squares: Vec4, xy: Vec4) -> [Vec4; 3] {
    let (c1, c2) = (Vec4::splat(C1), Vec4::splat(C2));
    let means = mean_x * mean_x + mean_y * mean_y;
    let xy = xy - mean_x * mean_y;
    let (a1, a2) = (mean_x * mean_y * 2.0 + c1, xy * 2.0 + c2);
    let (b1, b2) = (means + c1, squares - means + c2);
    let below = Vec4::ONE / (b1 * b2);
    let ssim = a1 * a2 * below;
    let by_variance = -ssim / b2;
    let by_covariance = a1 * below * 2.0;
    let by_mean = mean_y * a2 * below * 2.0
        - mean_x * ssim / b1 * 2.0
        - mean_x * by_variance * 2.0
        - mean_y * by_covariance;
    [by_mean, by_variance, by_covariance]
}

/// SSIM's derivatives: by the render's variance and the covariance, and by its mean.
fn columns<M: PairsMut + ?Sized>(
    params: &Params,
    maps: &M,
    partials: &mut M,
    means: &mut [f32],
    id: UVec3,
) {
    let run = Run::of_column(params, id);
    let [[x, other_x], [y, other_y]] = run.blurred_pair(maps, 0);
    let [[squares, other_squares], [xy, other_xy]] = run.blurred_pair(maps, 1);
    let [a, b, c] = partials_of(x, y, squares, xy);
    let [d, e, f] = partials_of(other_x, other_y, other_squares, other_xy);
    run.store_pair(partials, 0, [[b, e], [c, f]]);
    run.store(means, 0, [a, d]);
}

/// The derivatives, blurred along rows.
fn back<M: PairsMut + ?Sized>(
    params: &Params,
    partials: &M,
    maps: &mut M,
    means: &mut [f32],
    id: UVec3,
) {
    let run = Run::of_row(params, id);
    run.store_pair(maps, 0, run.blurred_pair(partials, 0));
    let by_mean = run.blurred(means, 0);
    run.store(means, 1, by_mean);
}

/// The loss's derivative by a value of the render, from SSIM's own.
fn by_value(training: &Training, x: f32, y: f32, ssim: f32) -> f32 {
    let huber = max(-1.0, min(1.0, (x - y) / max(training.knee, 1e-9)));
    ((1.0 - training.ssim) * huber - training.ssim * ssim) * training.per_value
}

/// The derivatives by all values.
fn values<M: PairsMut + ?Sized>(
    params: &Params,
    training: &Training,
    image: &[f32],
    frame: &[u32],
    maps: &M,
    means: &[f32],
    gradient: &mut [f32],
    id: UVec3,
) {
    let run = Run::of_column(params, id);
    let by_mean = run.blurred(means, 1);
    let [by_variance, by_covariance] = run.blurred_pair(maps, 0);
    let mut half = 0;
    while half < 2 {
        let (a, b, c) = if half == 0 {
            (by_mean[0], by_variance[0], by_covariance[0])
        } else {
            (by_mean[1], by_variance[1], by_covariance[1])
        };
        let mut row = 0;
        while row < 4 {
            let (pixel, inside) = run.tap(half * 4 + row + SSIM_REACH);
            let of = |v: Vec4| match row {
                0 => v.x,
                1 => v.y,
                2 => v.z,
                _ => v.w,
            };
            let of_frame: u32 = at(frame, pixel);
            let x = render_at(image, pixel, run.channel, of_frame);
            let y = frame_at(of_frame, run.channel);
            if inside {
                let ssim = of(a) + 2.0 * x * of(b) + y * of(c);
                let by = by_value(training, x, y, ssim);
                let by = if of_frame & FRAME_COUNTS != 0 { by } else { 0.0 };
                *at_mut(gradient, pixel * GRADIENT_PIXEL + run.channel) = by;
            }
            row += 1;
        }
        half += 1;
    }
}

/// Makes a form of the stages: their entry points, and how pairs of floats are loaded. One invocation per run: rows and
/// runs of columns, or columns and runs of rows, and channels.
macro_rules! form {
    ($rows:ident, $columns:ident, $back:ident, $gradient:ident, $pair:ty) => {
        #[spirv(compute(threads(8)))]
        pub fn $rows(
            #[spirv(global_invocation_id)] id: UVec3,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] image: &[f32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] frame: &[u32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] maps: &mut [$pair],
        ) {
            rows(params, image, frame, maps, id);
        }

        #[spirv(compute(threads(8)))]
        pub fn $columns(
            #[spirv(global_invocation_id)] id: UVec3,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] maps: &[$pair],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] partials: &mut [$pair],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] means: &mut [f32],
        ) {
            columns(params, maps, partials, means, id);
        }

        #[spirv(compute(threads(8)))]
        pub fn $back(
            #[spirv(global_invocation_id)] id: UVec3,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] partials: &[$pair],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] maps: &mut [$pair],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] means: &mut [f32],
        ) {
            back(params, partials, maps, means, id);
        }

        #[spirv(compute(threads(8)))]
        pub fn $gradient(
            #[spirv(global_invocation_id)] id: UVec3,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] training: &Training,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] image: &[f32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] frame: &[u32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] maps: &[$pair],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] means: &[f32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 6)] gradient: &mut [f32],
        ) {
            values(params, training, image, frame, maps, means, gradient, id);
        }
    };
}

form!(ssim_rows, ssim_columns, ssim_back, ssim_gradient, f32);
form!(
    ssim_rows_lockstep,
    ssim_columns_lockstep,
    ssim_back_lockstep,
    ssim_gradient_lockstep,
    u64
);

/// The derivatives along the render's colour; without SSIM, all of them. One invocation per pixel.
#[spirv(compute(threads(256)))]
pub fn loss_gradient(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] training: &Training,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] image: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] frame: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] gradient: &mut [f32],
) {
    let pixel = id.x;
    if pixel >= params.width * params.height {
        return;
    }
    let of_frame: u32 = at(frame, pixel);
    let mut along = 0.0;
    let mut channel = 0;
    while channel < 3 {
        let x = render_at(image, pixel, channel, of_frame);
        let place = pixel * GRADIENT_PIXEL + channel;
        let mut by: f32 = at(gradient, place);
        if training.ssim == 0.0 {
            by = by_value(training, x, frame_at(of_frame, channel), 0.0);
            *at_mut(gradient, place) = by;
        }
        along += by * x;
        channel += 1;
    }
    *at_mut(gradient, pixel * GRADIENT_PIXEL + 3) = along;
}
