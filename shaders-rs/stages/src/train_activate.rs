//! Stage `train_activate`: the parameters of training as the render's stages read splats, one invocation per splat.

use crate::memory::{at, at_mut};
use crate::shared::{Params, scaled};
use crate::training::{LOG_SCALE, OPACITY, POSITION, ROTATION, SH, Training};
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
    /// Length of the quaternion as it is trained.
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

impl Shape {
    pub fn load(parameters: &[f32], n: u32, i: u32) -> Shape {
        let [a, b, c] = triple(parameters, n, LOG_SCALE, i);
        let [w, x, y] = triple(parameters, n, ROTATION, i);
        let z = parameter(parameters, n, ROTATION + 3, i);
        let length = (w * w + x * x + y * y + z * z).sqrt();
        let by = 1.0 / length;
        let logit = parameter(parameters, n, OPACITY, i);
        Shape {
            position: triple(parameters, n, POSITION, i),
            scale: [a.exp(), b.exp(), c.exp()],
            rotation: [w * by, x * by, y * by, z * by],
            length,
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
fn put(planes: &mut [f32], splats: u32, plane: u32, i: u32, pair: [f32; 2]) {
    let first = 2 * (plane * splats + i);
    *at_mut(planes, first) = pair[0];
    *at_mut(planes, first + 1) = pair[1];
}

/// One invocation per splat.
#[spirv(compute(threads(256)))]
pub fn train_activate(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] training: &Training,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] parameters: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] geometry: &mut [f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] sh: &mut [f32],
) {
    let (n, i) = (params.splats, id.x);
    if i >= n {
        return;
    }
    let shape = Shape::load(parameters, n, i);
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
    let count = 3 * training.sh_coefficients;
    let mut k = 0;
    while k < count {
        let first = parameter(parameters, n, SH + k, i);
        let inside = k + 1 < count;
        let second = parameter(parameters, n, SH + if inside { k + 1 } else { k }, i);
        put(sh, n, k / 2, i, [first, if inside { second } else { 0.0 }]);
        k += 2;
    }
    // Two coefficients are three planes: a number of coefficients that is odd leaves a plane over, and a half.
    if count % 6 != 0 {
        put(sh, n, count.div_ceil(2), i, [0.0, 0.0]);
    }
}
