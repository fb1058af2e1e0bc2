//! Stage `train_activate`: the parameters of training as the render's stages read splats.

use crate::memory::{PairsMut, at, at_mut};
use crate::shared::{Params, scaled, sh_coefficients};
use crate::training::{
    LOG_SCALE, OPACITY, POSITION, ROTATION, ROUNDED_LOGITS, SH, Training, rounded,
};
use spirv_std::glam::UVec3;
use spirv_std::num_traits::Float;
use spirv_std::spirv;

/// A splat's parameters as they are trained, without the spherical harmonics.
#[derive(Clone, Copy)]
pub struct Trained {
    pub position: [f32; 3],
    pub log_scale: [f32; 3],
    pub rotation: [f32; 4],
    pub opacity: f32,
}

/// A splat as it is drawn, without the spherical harmonics.
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

/// Sets a number of a splat, of each of three planes.
pub fn put_triple(parameters: &mut [f32], splats: u32, plane: u32, i: u32, values: [f32; 3]) {
    *at_mut(parameters, plane * splats + i) = values[0];
    *at_mut(parameters, (plane + 1) * splats + i) = values[1];
    *at_mut(parameters, (plane + 2) * splats + i) = values[2];
}

/// Coefficient `k` of the spherical harmonics of a splat, RGB, as it is trained. `j`: its place among those trained.
pub fn harmonic(training: &Training, parameters: &[f32], k: u32, j: u32) -> [f32; 3] {
    triple(parameters, training.trained, SH + 3 * k, j)
}

/// Coefficient `k` as it is drawn.
pub fn drawn_harmonic(training: &Training, [r, g, b]: [f32; 3], k: u32) -> [f32; 3] {
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

/// An array of an expression of the number of a coefficient of the spherical harmonics. Written out: in a loop an array
/// would lie in memory.
macro_rules! coefficients {
    ($k:ident => $value:expr) => {
        coefficients!($k => $value; 0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15)
    };
    ($k:ident => $value:expr; $($index:literal)+) => {
        [$({ let $k: u32 = $index; $value }),+]
    };
}
pub(crate) use coefficients;

impl Trained {
    /// `j`: the splat's place among those that are trained.
    pub fn load(training: &Training, parameters: &[f32], j: u32) -> Trained {
        let n = training.trained;
        let [w, x, y] = triple(parameters, n, ROTATION, j);
        Trained {
            position: triple(parameters, n, POSITION, j),
            log_scale: triple(parameters, n, LOG_SCALE, j),
            rotation: [w, x, y, parameter(parameters, n, ROTATION + 3, j)],
            opacity: parameter(parameters, n, OPACITY, j),
        }
    }

    pub fn store(&self, training: &Training, parameters: &mut [f32], j: u32) {
        let n = training.trained;
        put_triple(parameters, n, POSITION, j, self.position);
        put_triple(parameters, n, LOG_SCALE, j, self.log_scale);
        let [w, x, y, z] = self.rotation;
        put_triple(parameters, n, ROTATION, j, [w, x, y]);
        *at_mut(parameters, (ROTATION + 3) * n + j) = z;
        *at_mut(parameters, OPACITY * n + j) = self.opacity;
    }
}

impl Shape {
    /// A splat as it is drawn.
    pub fn of(training: &Training, trained: &Trained) -> Shape {
        let by = training.rounding;
        let ([a, b, c], [w, x, y, z]) = (trained.log_scale, trained.rotation);
        let length = (w * w + x * x + y * y + z * z).sqrt();
        let inverse = 1.0 / length;
        let unit = [w * inverse, x * inverse, y * inverse, z * inverse];
        let turned = (by[2] > 0.0) & (w < 0.0);
        let logit = rounded_logit(trained.opacity, by[3]);
        let [px, py, pz] = trained.position;
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

/// Writes a splat as it is drawn. `i`: its place among all.
fn activate<M: PairsMut + ?Sized>(
    stride: u32,
    training: &Training,
    sh_degree: u32,
    parameters: &[f32],
    geometry: &mut M,
    sh: &mut M,
    j: u32,
) {
    let (n, i) = (stride, training.first_trained + j);
    let shape = Shape::of(training, &Trained::load(training, parameters, j));
    let [x, y, z] = shape.unit_axes();
    let [a, b, c] =
        [scaled(x, shape.scale[0]), scaled(y, shape.scale[1]), scaled(z, shape.scale[2])];
    let p = shape.position;
    geometry.put(i, [p[0], p[1]]);
    geometry.put(n + i, [p[2], shape.opacity]);
    geometry.put(2 * n + i, [a[0], a[1]]);
    geometry.put(3 * n + i, [a[2], b[0]]);
    geometry.put(4 * n + i, [b[1], b[2]]);
    geometry.put(5 * n + i, [c[0], c[1]]);
    geometry.put(6 * n + i, [c[2], 0.0]);
    let count = sh_coefficients(sh_degree);
    // Two coefficients are three planes.
    macro_rules! put {
        ($($two:literal)+) => {
            $(if 2 * $two < count {
                let (k, next) = (2 * $two, 2 * $two + 1);
                let own = harmonic(training, parameters, k, j);
                let [r, g, b] = drawn_harmonic(training, own, k);
                let [nr, ng, nb] =
                    if next < count { harmonic(training, parameters, next, j) } else { [0.0; 3] };
                let place = 3 * $two * n + i;
                sh.put(place, [r, g]);
                sh.put(place + n, [b, nr]);
                sh.put(place + 2 * n, [ng, nb]);
            })+
        };
    }
    put!(0 1 2 3 4 5 6 7);
}

/// Makes a form of the stage: its entry point, and how pairs of floats are written. One invocation per splat that is
/// trained.
macro_rules! form {
    ($name:ident, $pair:ty) => {
        /// Writes splats as they are drawn.
        #[spirv(compute(threads(256)))]
        pub fn $name(
            #[spirv(global_invocation_id)] id: UVec3,
            #[spirv(spec_constant(id = 0, default = 3))] sh_degree: u32,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] training: &Training,
            #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] parameters: &[f32],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] geometry: &mut [$pair],
            #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] sh: &mut [$pair],
        ) {
            if id.x < training.in_use {
                activate(params.stride, training, sh_degree, parameters, geometry, sh, id.x);
            }
        }
    };
}

form!(train_activate, f32);
form!(train_activate_lockstep, u64);
