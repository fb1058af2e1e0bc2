//! Stage `train_activate`: the parameters of training as the render's stages read splats.

use crate::memory::{at, at_mut};
use crate::shared::{Params, scaled};
use crate::training::{
    LOG_SCALE, OPACITY, POSITION, ROTATION, ROUNDED_LOGITS, SH, Training, rounded,
};
use spirv_std::glam::UVec3;
use spirv_std::num_traits::Float;
use spirv_std::spirv;

/// A splat's parameters, without the spherical harmonics.
pub struct Shape {
    pub position: [f32; 3],
    /// Standard deviations.
    pub scale: [f32; 3],
    /// Quaternion (w, x, y, z) of length 1.
    pub rotation: [f32; 4],
    /// Length of the quaternion as it is trained; below 0 if `rotation` is turned to the other sign.
    pub length: f32,
    pub opacity: f32,
}

/// A number of a splat, of a plane.
pub fn parameter(parameters: &[f32], splats: u32, plane: u32, i: u32) -> f32 {
    at(parameters, plane * splats + i)
}

/// A number of a splat, of each of three planes.
pub fn triple(parameters: &[f32], splats: u32, plane: u32, i: u32) -> [f32; 3] {
    [
        parameter(parameters, splats, plane, i),
        parameter(parameters, splats, plane + 1, i),
        parameter(parameters, splats, plane + 2, i),
    ]
}

/// Coefficient `k` of a splat's spherical harmonics, RGB, as it is drawn. `j`: its place among those that are trained.
pub fn harmonic(training: &Training, parameters: &[f32], k: u32, j: u32) -> [f32; 3] {
    let [r, g, b] = triple(parameters, training.trained, SH + 3 * k, j);
    let by = if k == 0 { training.rounding[4] } else { 0.0 };
    [rounded(r, by), rounded(g, by), rounded(b, by)]
}

/// A unit quaternion, rounded. Its w is not negative and follows from the others.
fn rounded_rotation([w, x, y, z]: [f32; 4], step: f32) -> [f32; 4] {
    if !(step > 0.0) {
        return [w, x, y, z];
    }
    let sign = if w < 0.0 { -1.0 } else { 1.0 };
    let (x, y, z) = (rounded(sign * x, step), rounded(sign * y, step), rounded(sign * z, step));
    let square = x * x + y * y + z * z;
    if square < 1.0 {
        return [(1.0 - square).sqrt(), x, y, z];
    }
    let by = 1.0 / square.sqrt();
    [0.0, x * by, y * by, z * by]
}

/// An opacity's logit, rounded.
fn rounded_logit(logit: f32, step: f32) -> f32 {
    if !(step > 0.0) {
        return logit;
    }
    let [least, most] = [ROUNDED_LOGITS[0] * step, ROUNDED_LOGITS[1] * step];
    let held = if logit > least { logit } else { least };
    rounded(if held < most { held } else { most }, step)
}

impl Shape {
    /// A splat as it is drawn. `j`: its place among those that are trained.
    pub fn load(training: &Training, parameters: &[f32], j: u32) -> Shape {
        let (n, by) = (training.trained, training.rounding);
        let [a, b, c] = triple(parameters, n, LOG_SCALE, j);
        let [w, x, y] = triple(parameters, n, ROTATION, j);
        let z = parameter(parameters, n, ROTATION + 3, j);
        let length = (w * w + x * x + y * y + z * z).sqrt();
        let inverse = 1.0 / length;
        let unit = [w * inverse, x * inverse, y * inverse, z * inverse];
        let turned = (by[2] > 0.0) & (w < 0.0);
        let logit = rounded_logit(parameter(parameters, n, OPACITY, j), by[3]);
        let [px, py, pz] = triple(parameters, n, POSITION, j);
        Shape {
            position: [rounded(px, by[0]), rounded(py, by[0]), rounded(pz, by[0])],
            scale: [rounded(a, by[1]).exp(), rounded(b, by[1]).exp(), rounded(c, by[1]).exp()],
            rotation: rounded_rotation(unit, by[2]),
            length: if turned { -length } else { length },
            opacity: 1.0 / (1.0 + (-logit).exp()),
        }
    }

    /// The splat's own axes in the world.
    pub fn unit_axes(&self) -> [[f32; 3]; 3] {
        let [w, x, y, z] = self.rotation;
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)],
            [2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)],
            [2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    }
}

/// Writes pair `plane` of splat `i`.
fn put(planes: &mut [f32], stride: u32, plane: u32, i: u32, pair: [f32; 2]) {
    let first = 2 * (plane * stride + i);
    *at_mut(planes, first) = pair[0];
    *at_mut(planes, first + 1) = pair[1];
}

/// One invocation per splat that is trained.
#[spirv(compute(threads(256)))]
pub fn train_activate(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] training: &Training,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] parameters: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] geometry: &mut [f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] sh: &mut [f32],
) {
    let (n, j) = (params.stride, id.x);
    if j >= training.trained {
        return;
    }
    let i = training.first_trained + j;
    let shape = Shape::load(training, parameters, j);
    let [x, y, z] = shape.unit_axes();
    let [a, b, c] =
        [scaled(x, shape.scale[0]), scaled(y, shape.scale[1]), scaled(z, shape.scale[2])];
    let p = shape.position;
    put(geometry, n, 0, i, [p[0], p[1]]);
    put(geometry, n, 1, i, [p[2], shape.opacity]);
    put(geometry, n, 2, i, [a[0], a[1]]);
    put(geometry, n, 3, i, [a[2], b[0]]);
    put(geometry, n, 4, i, [b[1], b[2]]);
    put(geometry, n, 5, i, [c[0], c[1]]);
    put(geometry, n, 6, i, [c[2], 0.0]);
    let count = training.sh_coefficients;
    let mut k = 0;
    // Two coefficients are three planes.
    while k < count {
        let [r, g, b] = harmonic(training, parameters, k, j);
        let inside = k + 1 < count;
        let next = harmonic(training, parameters, if inside { k + 1 } else { k }, j);
        let [nr, ng, nb] = if inside { next } else { [0.0; 3] };
        let plane = 3 * (k / 2);
        put(sh, n, plane, i, [r, g]);
        put(sh, n, plane + 1, i, [b, nr]);
        put(sh, n, plane + 2, i, [ng, nb]);
        k += 2;
    }
}
