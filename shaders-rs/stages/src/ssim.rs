//! Stages `ssim_rows`, `ssim_columns`, `ssim_back`, `loss_gradient`: the gradient of the training loss by each pixel of
//! the render, `(1 − s) |render − frame| + s (1 − SSIM)`, means over pixels and channels (Kerbl et al. 2023, eq. 7; SSIM of
//! Wang et al. 2004). The window is separable: rows, then columns. Beyond the picture all is zero.

use crate::memory::{at, at_mut};
use crate::shared::{PIXEL, Params};
use crate::training::{
    GRADIENT_PIXEL, SSIM_MAPS, SSIM_PARTIALS, SSIM_REACH, SSIM_WEIGHTS, Training,
};
use spirv_std::glam::UVec3;
use spirv_std::spirv;

/// Stabilise quotients of small numbers, for values in [0, 1].
const C1: f32 = 0.01 * 0.01;
const C2: f32 = 0.03 * 0.03;

/// A channel of the frame's pixel, in [0, 1].
fn frame_at(frame: &[u32], pixel: u32, channel: u32) -> f32 {
    let byte = 3 * pixel + channel;
    let word: u32 = at(frame, byte / 4);
    (word >> (byte % 4 * 8) & 255) as f32 * (1.0 / 255.0)
}

fn render_at(image: &[f32], pixel: u32, channel: u32) -> f32 {
    at(image, pixel * PIXEL + channel)
}

/// The weight of the tap at a signed offset from the middle.
fn weight(tap: u32) -> f32 {
    SSIM_WEIGHTS[if tap > SSIM_REACH { tap - SSIM_REACH } else { SSIM_REACH - tap } as usize]
}

/// The pixel and the channel of an invocation, and the pixel's place along the row or column.
struct Place {
    pixel: u32,
    channel: u32,
    pixels: u32,
}

impl Place {
    fn new(params: &Params, id: UVec3) -> Place {
        Place { pixel: id.x, channel: id.y, pixels: params.width * params.height }
    }

    /// Where a map of this channel begins.
    fn map(&self, map: u32) -> u32 {
        (map * 3 + self.channel) * self.pixels
    }
}

/// One invocation per pixel and channel: `width · height` by 3.
#[spirv(compute(threads(256)))]
pub fn ssim_rows(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] image: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] frame: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] maps: &mut [f32],
) {
    let place = Place::new(params, id);
    if place.pixel >= place.pixels {
        return;
    }
    let column = place.pixel % params.width;
    let mut sums = [0.0; SSIM_MAPS as usize];
    let mut tap = 0;
    while tap <= 2 * SSIM_REACH {
        let at_column = column + tap;
        if (at_column >= SSIM_REACH) & (at_column < params.width + SSIM_REACH) {
            let pixel = place.pixel + tap - SSIM_REACH;
            let x = render_at(image, pixel, place.channel);
            let y = frame_at(frame, pixel, place.channel);
            let w = weight(tap);
            sums[0] += w * x;
            sums[1] += w * y;
            sums[2] += w * x * x;
            sums[3] += w * y * y;
            sums[4] += w * x * y;
        }
        tap += 1;
    }
    let mut map = 0;
    while map < SSIM_MAPS {
        *at_mut(maps, place.map(map) + place.pixel) = sums[map as usize];
        map += 1;
    }
}

/// A map, blurred along columns.
fn down(params: &Params, maps: &[f32], first: u32, pixel: u32) -> f32 {
    let row = pixel / params.width;
    let mut sum = 0.0;
    let mut tap = 0;
    while tap <= 2 * SSIM_REACH {
        let at_row = row + tap;
        if (at_row >= SSIM_REACH) & (at_row < params.height + SSIM_REACH) {
            let pixel = pixel + tap * params.width - SSIM_REACH * params.width;
            sum += weight(tap) * at::<f32, _>(maps, first + pixel);
        }
        tap += 1;
    }
    sum
}

/// SSIM's derivatives at each pixel. One invocation per pixel and channel.
#[spirv(compute(threads(256)))]
pub fn ssim_columns(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] maps: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] partials: &mut [f32],
) {
    let place = Place::new(params, id);
    if place.pixel >= place.pixels {
        return;
    }
    let mean_x = down(params, maps, place.map(0), place.pixel);
    let mean_y = down(params, maps, place.map(1), place.pixel);
    let xx = down(params, maps, place.map(2), place.pixel) - mean_x * mean_x;
    let yy = down(params, maps, place.map(3), place.pixel) - mean_y * mean_y;
    let xy = down(params, maps, place.map(4), place.pixel) - mean_x * mean_y;
    let (a1, a2) = (2.0 * mean_x * mean_y + C1, 2.0 * xy + C2);
    let (b1, b2) = (mean_x * mean_x + mean_y * mean_y + C1, xx + yy + C2);
    let below = 1.0 / (b1 * b2);
    let ssim = a1 * a2 * below;
    let by_variance = -ssim / b2;
    let by_covariance = 2.0 * a1 * below;
    let by_mean = 2.0 * mean_y * a2 * below
        - 2.0 * mean_x * ssim / b1
        - 2.0 * mean_x * by_variance
        - mean_y * by_covariance;
    *at_mut(partials, place.map(0) + place.pixel) = by_mean;
    *at_mut(partials, place.map(1) + place.pixel) = by_variance;
    *at_mut(partials, place.map(2) + place.pixel) = by_covariance;
}

/// The derivatives, blurred along rows. One invocation per pixel and channel.
#[spirv(compute(threads(256)))]
pub fn ssim_back(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] partials: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] blurred: &mut [f32],
) {
    let place = Place::new(params, id);
    if place.pixel >= place.pixels {
        return;
    }
    let column = place.pixel % params.width;
    let mut sums = [0.0; SSIM_PARTIALS as usize];
    let mut tap = 0;
    while tap <= 2 * SSIM_REACH {
        let at_column = column + tap;
        if (at_column >= SSIM_REACH) & (at_column < params.width + SSIM_REACH) {
            let pixel = place.pixel + tap - SSIM_REACH;
            let w = weight(tap);
            sums[0] += w * at::<f32, _>(partials, place.map(0) + pixel);
            sums[1] += w * at::<f32, _>(partials, place.map(1) + pixel);
            sums[2] += w * at::<f32, _>(partials, place.map(2) + pixel);
        }
        tap += 1;
    }
    let mut map = 0;
    while map < SSIM_PARTIALS {
        *at_mut(blurred, place.map(map) + place.pixel) = sums[map as usize];
        map += 1;
    }
}

/// The loss's derivative by a channel of a pixel.
fn channel(
    params: &Params,
    training: &Training,
    image: &[f32],
    frame: &[u32],
    blurred: &[f32],
    place: &Place,
) -> f32 {
    let x = render_at(image, place.pixel, place.channel);
    let y = frame_at(frame, place.pixel, place.channel);
    let by_mean = down(params, blurred, place.map(0), place.pixel);
    let by_variance = down(params, blurred, place.map(1), place.pixel);
    let by_covariance = down(params, blurred, place.map(2), place.pixel);
    let ssim = by_mean + 2.0 * x * by_variance + y * by_covariance;
    let sign = if x > y { 1.0 } else if x < y { -1.0 } else { 0.0 };
    ((1.0 - training.ssim) * sign - training.ssim * ssim) * training.per_value
}

/// One invocation per pixel.
#[spirv(compute(threads(256)))]
pub fn loss_gradient(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] training: &Training,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] image: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] frame: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] blurred: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] gradient: &mut [f32],
) {
    let (pixel, pixels) = (id.x, params.width * params.height);
    if pixel >= pixels {
        return;
    }
    let mut along = 0.0;
    let mut c = 0;
    while c < 3 {
        let place = Place { pixel, channel: c, pixels };
        let by = channel(params, training, image, frame, blurred, &place);
        *at_mut(gradient, pixel * GRADIENT_PIXEL + c) = by;
        along += by * render_at(image, pixel, c);
        c += 1;
    }
    *at_mut(gradient, pixel * GRADIENT_PIXEL + 3) = along;
}
