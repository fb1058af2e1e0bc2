//! A splat's sums over its tiles, and from them the loss's gradient by all of its parameters: for stages `train_step`
//! and `train_gradient`.
//!
//! With `d` a pixel less the mean, `ln α = ln o − ½ dᵀ Q d`: the mean's gradient is `Q Σ h d`, that of the covariance
//! `Σ'` is `½ Q (Σ h d dᵀ) Q`. The rest is the chain rule through [`shared::project`](crate::shared::project), as
//! derived for gsplat (Ye et al. 2025, appendix).

use crate::memory::{Pairs, at};
use crate::shared::{
    self, Outline, Params, RATIO_MIN, TILE, clamped_ray, cross, dilated, dot, projected_axes,
    scaled, transform,
};
use crate::train_activate::{Shape, coefficients, drawn_harmonic, harmonic};
use crate::train_slots;
use crate::training::{NO_PAIR, PAIR_FLOATS, Training, slot_box};
use spirv_std::glam::Vec4;

/// The loss's gradient by what a splat is in the picture.
struct Seen {
    colour: [f32; 3],
    mean: [f32; 2],
    /// By the covariance: xx, xy (standing for both places), yy.
    covariance: [f32; 3],
    /// By the logarithm of the opacity.
    log_opacity: f32,
}

/// A vector times the conic Q, which is LᵀL: L's rows are (l11, l21) and (0, l22).
fn times_q(conic: [f32; 3], v: [f32; 2]) -> [f32; 2] {
    let [l11, l21, l22] = conic;
    let (a, b) = (l11 * v[0] + l21 * v[1], l22 * v[1]);
    [l11 * a, l21 * a + l22 * b]
}

/// Adds up a splat's pairs, tile by tile.
fn gather<P: Pairs + ?Sized>(
    params: &Params,
    records: &[Vec4],
    starts: &[u32],
    slots: &[u32],
    pairs: &P,
    i: u32,
) -> Seen {
    let record = train_slots::load(records, i);
    let [x0, y0, x1, y1] = slot_box(params, &Outline::new(params, &record));
    let first_slot: u32 = at(starts, i);
    let mut colour = [0.0; 3];
    let (mut h, mut hd, mut hdd) = (0.0, [0.0; 2], [0.0; 3]);
    // One loop over all tiles: two, one within the other, would wait for the widest and the tallest of neighbours.
    let (count, mut k) = ((x1 - x0) * (y1 - y0), 0);
    let (mut x, mut y) = (x0, y0);
    while k < count {
        let pair: u32 = at(slots, first_slot + k);
        if pair != NO_PAIR {
            let first = pair * PAIR_FLOATS;
            let ([r, g], [b, own]) = (pairs.pair(first), pairs.pair(first + 1));
            let ([hx, hy], [hxx, hxy]) = (pairs.pair(first + 2), pairs.pair(first + 3));
            let [hyy, _] = pairs.pair(first + 4);
            colour = [colour[0] + r, colour[1] + g, colour[2] + b];
            // From the tile's middle to the mean.
            let half = (TILE / 2) as f32;
            let mx = record.mean[0] - ((x * TILE) as f32 + half);
            let my = record.mean[1] - ((y * TILE) as f32 + half);
            h += own;
            hd = [hd[0] + (hx - mx * own), hd[1] + (hy - my * own)];
            hdd = [
                hdd[0] + (hxx - mx * (2.0 * hx - mx * own)),
                hdd[1] + (hxy - mx * hy - my * (hx - mx * own)),
                hdd[2] + (hyy - my * (2.0 * hy - my * own)),
            ];
        }
        k += 1;
        x += 1;
        let ended = x == x1;
        x = if ended { x0 } else { x };
        y += ended as u32;
    }
    let q = record.conic;
    let (left, right) = (times_q(q, [hdd[0], hdd[1]]), times_q(q, [hdd[1], hdd[2]]));
    let (upper, lower) = (times_q(q, [left[0], right[0]]), times_q(q, [left[1], right[1]]));
    Seen {
        colour,
        mean: times_q(q, hd),
        covariance: [0.5 * upper[0], 0.5 * upper[1], 0.5 * lower[1]],
        log_opacity: h,
    }
}

/// What colours say.
struct Colours {
    /// The gradient by the colour; 0 in channels that are clamped.
    by_colour: [f32; 3],
    /// The gradient by the position, as colours depend on the direction.
    by_position: [f32; 3],
    /// Values of the spherical harmonics; 0 of those that are not trained.
    basis: [f32; 16],
}

/// All in one pass over the coefficients, so that none of them stays in registers.
fn colours(
    params: &Params,
    training: &Training,
    parameters: &[f32],
    count: u32,
    by_colour: [f32; 3],
    position: [f32; 3],
    j: u32,
) -> Colours {
    let (d, inverse) = shared::direction(params, position);
    let (basis, slopes) = (shared::sh_basis(d), shared::sh_basis_gradient(d));
    let basis = coefficients!(k => if k < training.sh_trained { basis[k as usize] } else { 0.0 });
    let mut rgb = [0.5, 0.5, 0.5];
    // Gradients of red, green and blue by the direction.
    let (mut red, mut green, mut blue) = ([0.0; 3], [0.0; 3], [0.0; 3]);
    coefficients!(k => if k < count {
        let [r, g, b] = drawn_harmonic(training, harmonic(training, parameters, k, j), k);
        let (value, slope) = (basis[k as usize], slopes[k as usize]);
        rgb = [rgb[0] + value * r, rgb[1] + value * g, rgb[2] + value * b];
        (red, green, blue) = (added(red, r, slope), added(green, g, slope), added(blue, b, slope));
    });
    let by = [
        if rgb[0] > 0.0 { by_colour[0] } else { 0.0 },
        if rgb[1] > 0.0 { by_colour[1] } else { 0.0 },
        if rgb[2] > 0.0 { by_colour[2] } else { 0.0 },
    ];
    let along = added(added(scaled(red, by[0]), by[1], green), by[2], blue);
    let radial = dot(along, d);
    let by_position = [
        (along[0] - radial * d[0]) * inverse,
        (along[1] - radial * d[1]) * inverse,
        (along[2] - radial * d[2]) * inverse,
    ];
    Colours { by_colour: by, by_position, basis }
}

/// `sum + by · v`.
fn added(sum: [f32; 3], by: f32, v: [f32; 3]) -> [f32; 3] {
    [sum[0] + by * v[0], sum[1] + by * v[1], sum[2] + by * v[2]]
}

/// `Mᵀ v` of a row-major matrix.
fn transform_back(m: &[f32; 9], v: [f32; 3]) -> [f32; 3] {
    [
        m[0] * v[0] + m[3] * v[1] + m[6] * v[2],
        m[1] * v[0] + m[4] * v[1] + m[7] * v[2],
        m[2] * v[0] + m[5] * v[1] + m[8] * v[2],
    ]
}

/// The gradient by the quaternion, of any length and sign, from that by the unit axes.
fn by_rotation(shape: &Shape, by_axes: [[f32; 3]; 3]) -> [f32; 4] {
    let [w, x, y, z] = shape.rotation;
    let [[b00, b10, b20], [b01, b11, b21], [b02, b12, b22]] = by_axes;
    let g = [
        2.0 * (z * (b10 - b01) + y * (b02 - b20) + x * (b21 - b12)),
        2.0 * (y * (b01 + b10) + z * (b02 + b20) + w * (b21 - b12) - 2.0 * x * (b11 + b22)),
        2.0 * (x * (b01 + b10) + z * (b12 + b21) + w * (b02 - b20) - 2.0 * y * (b00 + b22)),
        2.0 * (x * (b02 + b20) + y * (b12 + b21) + w * (b10 - b01) - 2.0 * z * (b00 + b11)),
    ];
    let along = g[0] * w + g[1] * x + g[2] * y + g[3] * z;
    let by = 1.0 / shape.length;
    [
        by * (g[0] - along * w),
        by * (g[1] - along * x),
        by * (g[2] - along * y),
        by * (g[3] - along * z),
    ]
}

/// The gradient by the covariance, opacity's compensation of the low-pass included.
fn by_covariance(params: &Params, seen: &Seen, m0: [f32; 3], m1: [f32; 3]) -> [f32; 3] {
    let [mut xx, mut xy, mut yy] = seen.covariance;
    if params.dilation_kept < params.dilation {
        let minors = cross(m0, m1);
        let (a, b, c) = (dot(m0, m0), dot(m0, m1), dot(m1, m1));
        let det0 = dot(minors, minors);
        let (low_pass, kept) = (params.dilation, params.dilation_kept);
        let (det, det_kept) = (dilated(det0, a + c, low_pass), dilated(det0, a + c, kept));
        if det_kept > RATIO_MIN * det {
            // ½ h (Σ_kept⁻¹ − Σ'⁻¹).
            let (k, l) = (0.5 * seen.log_opacity / det_kept, 0.5 * seen.log_opacity / det);
            xx += k * (c + kept) - l * (c + low_pass);
            yy += k * (a + kept) - l * (a + low_pass);
            xy -= (k - l) * b;
        }
    }
    [xx, xy, yy]
}

/// The gradients by position and unit axes (columns), and by the logarithms of the standard deviations.
struct Spatial {
    position: [f32; 3],
    axes: [[f32; 3]; 3],
    log_scale: [f32; 3],
}

/// `a · u + b · v`.
fn mix(u: [f32; 3], a: f32, v: [f32; 3], b: f32) -> [f32; 3] {
    [a * u[0] + b * v[0], a * u[1] + b * v[1], a * u[2] + b * v[2]]
}

/// The gradient by an axis in the world, from that by its projections.
fn by_axis(params: &Params, ray: [f32; 2], across: f32, down: f32) -> [f32; 3] {
    transform_back(&params.rotation, [across, down, -across * ray[0] - down * ray[1]])
}

fn spatial(params: &Params, shape: &Shape, seen: &Seen) -> Spatial {
    let [x, y, z] = shape.unit_axes();
    let [a, b, c] = shape.scale;
    let world = [scaled(x, a), scaled(y, b), scaled(z, c)];
    let turned = transform(&params.rotation, shape.position);
    let t = params.translation;
    let p = [turned[0] + t[0], turned[1] + t[1], turned[2] + t[2]];
    let v = [
        transform(&params.rotation, world[0]),
        transform(&params.rotation, world[1]),
        transform(&params.rotation, world[2]),
    ];
    let (ray, inside) = clamped_ray(params, p);
    let (m0, m1) = projected_axes(params, p[2], ray, &v);
    let [xx, xy, yy] = by_covariance(params, seen, m0, m1);
    let (g0, g1) = (mix(m0, 2.0 * xx, m1, 2.0 * xy), mix(m0, 2.0 * xy, m1, 2.0 * yy));
    let inverse_z = 1.0 / p[2];
    let (sx, sy) = (params.focal[0] * inverse_z, params.focal[1] * inverse_z);
    // By the rays at which the projection is linearised.
    let depths = [v[0][2], v[1][2], v[2][2]];
    let rx = if inside[0] { -sx * dot(g0, depths) } else { 0.0 };
    let ry = if inside[1] { -sy * dot(g1, depths) } else { 0.0 };
    let [gu, gv] = seen.mean;
    let by_x = (params.focal[0] * gu + rx) * inverse_z;
    let by_y = (params.focal[1] * gv + ry) * inverse_z;
    let by_z = -(dot(g0, m0) + dot(g1, m1)) * inverse_z - (by_x * p[0] + by_y * p[1]) * inverse_z;
    let by_world = [
        by_axis(params, ray, sx * g0[0], sy * g1[0]),
        by_axis(params, ray, sx * g0[1], sy * g1[1]),
        by_axis(params, ray, sx * g0[2], sy * g1[2]),
    ];
    Spatial {
        position: transform_back(&params.rotation, [by_x, by_y, by_z]),
        axes: [
            scaled(by_world[0], shape.scale[0]),
            scaled(by_world[1], shape.scale[1]),
            scaled(by_world[2], shape.scale[2]),
        ],
        log_scale: [
            dot(by_world[0], world[0]),
            dot(by_world[1], world[1]),
            dot(by_world[2], world[2]),
        ],
    }
}

/// The loss's gradient by a splat's parameters.
pub struct Gradient {
    pub position: [f32; 3],
    pub log_scale: [f32; 3],
    pub rotation: [f32; 4],
    /// By the logit of the opacity.
    pub opacity: f32,
    /// By the colour. That by coefficient `k` is `basis[k]` times it.
    pub colour: [f32; 3],
    pub basis: [f32; 16],
}

/// A splat so far out of proportion that its gradient overflows stays as it is.
fn finite(value: f32) -> f32 {
    if value.abs() < 1e30 { value } else { 0.0 }
}

fn all_finite([a, b, c]: [f32; 3]) -> [f32; 3] {
    [finite(a), finite(b), finite(c)]
}

impl Gradient {
    /// Of the splat at place `j` of those that are trained, from what stage `splat_backward` has summed. It must have
    /// slots. `count`: coefficients of the spherical harmonics that there are.
    pub fn of<P: Pairs + ?Sized>(
        params: &Params,
        training: &Training,
        shape: &Shape,
        parameters: &[f32],
        count: u32,
        records: &[Vec4],
        starts: &[u32],
        slots: &[u32],
        pairs: &P,
        j: u32,
    ) -> Gradient {
        let i = training.first_trained + j;
        let seen = gather(params, records, starts, slots, pairs, i);
        let colours = colours(params, training, parameters, count, seen.colour, shape.position, j);
        let Spatial { position, axes, log_scale } = spatial(params, shape, &seen);
        let [a, b, c] = colours.by_position;
        let [q0, q1, q2, q3] = by_rotation(shape, axes);
        Gradient {
            position: all_finite([position[0] + a, position[1] + b, position[2] + c]),
            log_scale: all_finite(log_scale),
            rotation: [finite(q0), finite(q1), finite(q2), finite(q3)],
            opacity: finite(seen.log_opacity * (1.0 - shape.opacity)),
            colour: colours.by_colour,
            basis: colours.basis,
        }
    }
}
