//! Stages `ssim_rows`, `ssim_columns`, `ssim_back`, `ssim_gradient`, `loss_gradient`: the gradient of the training loss
//! by each pixel of the render, `(1 − s) h(render − frame) + s (1 − SSIM)`, means over pixels and channels (Kerbl et
//! al. 2023, eq. 7; SSIM of Wang et al. 2004). `h(d)` is the absolute value less half the knee, below the knee
//! `d² / (2 knee)` (Huber 1964). The window is separable: rows, then columns. Beyond the picture all is zero, as are
//! pixels that do not count, in render and frame.
//!
//! An invocation blurs [`RUN`] pixels in a row or column, so that each value is loaded 2.25 times, not 11 times:
//! docs/decisions.md, 8.

use crate::memory::{at, at_mut};
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
    /// By rows: one invocation per row (x) and run of columns (y).
    fn of_row(params: &Params, id: UVec3) -> Run {
        let (length, breadth) = (params.width, params.height);
        let (along, across) = (id.y * RUN, id.x);
        Run { along, across, length, breadth, step: 1, stride: params.width, channel: id.z }
    }

    /// By columns: one invocation per column (x) and run of rows (y).
    fn of_column(params: &Params, id: UVec3) -> Run {
        let (length, breadth) = (params.height, params.width);
        let (along, across) = (id.y * RUN, id.x);
        Run { along, across, length, breadth, step: params.width, stride: 1, channel: id.z }
    }

    fn is_there(self) -> bool {
        self.across < self.breadth
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

    /// Writes a run to a map.
    fn store(self, maps: &mut [f32], map: u32, [upper, lower]: Blurred) {
        let first = self.map(map);
        self.store_at(maps, first, 0, upper.x);
        self.store_at(maps, first, 1, upper.y);
        self.store_at(maps, first, 2, upper.z);
        self.store_at(maps, first, 3, upper.w);
        self.store_at(maps, first, 4, lower.x);
        self.store_at(maps, first, 5, lower.y);
        self.store_at(maps, first, 6, lower.z);
        self.store_at(maps, first, 7, lower.w);
    }

    fn store_at(self, maps: &mut [f32], first: u32, k: u32, value: f32) {
        let (pixel, inside) = self.tap(k + SSIM_REACH);
        if inside {
            *at_mut(maps, first + pixel) = value;
        }
    }
}

/// One invocation per run: rows, runs of columns, channels.
#[spirv(compute(threads(8)))]
pub fn ssim_rows(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] image: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] frame: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] maps: &mut [f32],
) {
    let run = Run::of_row(params, id);
    if !run.is_there() {
        return;
    }
    let pixels = line!(k => {
        let (pixel, inside) = run.tap(k);
        let value: u32 = at(frame, pixel);
        if inside { value } else { 0 }
    });
    let x = line!(k => render_at(image, run.tap(k).0, run.channel, pixels[k as usize]));
    let y = line!(k => frame_at(pixels[k as usize], run.channel));
    run.store(maps, 0, blurred(&x));
    run.store(maps, 1, blurred(&y));
    run.store(maps, 2, blurred(&line!(k => x[k as usize] * x[k as usize])));
    run.store(maps, 3, blurred(&line!(k => y[k as usize] * y[k as usize])));
    run.store(maps, 4, blurred(&line!(k => x[k as usize] * y[k as usize])));
}

/// SSIM's derivatives at four pixels, by the render's mean, its variance and the covariance, from blurred maps.
fn partials_of(mean_x: Vec4, mean_y: Vec4, xx: Vec4, yy: Vec4, xy: Vec4) -> [Vec4; 3] {
    let (c1, c2) = (Vec4::splat(C1), Vec4::splat(C2));
    let xx = xx - mean_x * mean_x;
    let yy = yy - mean_y * mean_y;
    let xy = xy - mean_x * mean_y;
    let (a1, a2) = (mean_x * mean_y * 2.0 + c1, xy * 2.0 + c2);
    let (b1, b2) = (mean_x * mean_x + mean_y * mean_y + c1, xx + yy + c2);
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

/// SSIM's derivatives. One invocation per run: columns, runs of rows, channels.
#[spirv(compute(threads(8)))]
pub fn ssim_columns(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] maps: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] partials: &mut [f32],
) {
    let run = Run::of_column(params, id);
    if !run.is_there() {
        return;
    }
    let [x, other_x] = run.blurred(maps, 0);
    let [y, other_y] = run.blurred(maps, 1);
    let [xx, other_xx] = run.blurred(maps, 2);
    let [yy, other_yy] = run.blurred(maps, 3);
    let [xy, other_xy] = run.blurred(maps, 4);
    let [a, b, c] = partials_of(x, y, xx, yy, xy);
    let [d, e, f] = partials_of(other_x, other_y, other_xx, other_yy, other_xy);
    run.store(partials, 0, [a, d]);
    run.store(partials, 1, [b, e]);
    run.store(partials, 2, [c, f]);
}

/// The derivatives, blurred along rows. One invocation per run: rows, runs of columns, channels.
#[spirv(compute(threads(8)))]
pub fn ssim_back(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] partials: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] maps: &mut [f32],
) {
    let run = Run::of_row(params, id);
    if run.is_there() {
        run.store(maps, 0, run.blurred(partials, 0));
        run.store(maps, 1, run.blurred(partials, 1));
        run.store(maps, 2, run.blurred(partials, 2));
    }
}

/// The loss's derivative by a value of the render, from SSIM's own.
fn by_value(training: &Training, x: f32, y: f32, ssim: f32) -> f32 {
    let huber = max(-1.0, min(1.0, (x - y) / max(training.knee, 1e-9)));
    ((1.0 - training.ssim) * huber - training.ssim * ssim) * training.per_value
}

/// The derivatives by all values. One invocation per run: columns, runs of rows, channels.
#[spirv(compute(threads(8)))]
pub fn ssim_gradient(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] training: &Training,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] image: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] frame: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] maps: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] gradient: &mut [f32],
) {
    let run = Run::of_column(params, id);
    if !run.is_there() {
        return;
    }
    let by_mean = run.blurred(maps, 0);
    let by_variance = run.blurred(maps, 1);
    let by_covariance = run.blurred(maps, 2);
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
