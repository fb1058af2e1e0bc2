//! Stage `train_gradient`: the loss's gradient by all parameters, one invocation per splat that is trained. Training
//! needs it only for checks: stage `train_step` takes its step without writing the gradient down.

use crate::memory::at_mut;
use crate::shared::Params;
use crate::splat_gradient::Gradient;
use crate::train_activate::Shape;
use crate::training::{LOG_SCALE, OPACITY, POSITION, ROTATION, SH, Training};
use spirv_std::glam::{UVec3, Vec4};
use spirv_std::spirv;

/// One invocation per splat.
#[spirv(compute(threads(256)))]
pub fn train_gradient(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] params: &Params,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] training: &Training,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] parameters: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] records: &[Vec4],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] starts: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] slots: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 6)] pairs: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 7)] gradients: &mut [f32],
) {
    let (n, j) = (training.trained, id.x);
    if j >= n {
        return;
    }
    let shape = Shape::load(training, parameters, j);
    let own = Gradient::of(params, training, parameters, &shape, records, starts, slots, pairs, j);
    let mut k = 0;
    while k < 3 {
        *at_mut(gradients, (POSITION + k) * n + j) = own.position[k as usize];
        *at_mut(gradients, (LOG_SCALE + k) * n + j) = own.log_scale[k as usize];
        k += 1;
    }
    let mut k = 0;
    while k < 4 {
        *at_mut(gradients, (ROTATION + k) * n + j) = own.rotation[k as usize];
        k += 1;
    }
    *at_mut(gradients, OPACITY * n + j) = own.opacity;
    let mut k = 0;
    while k < training.sh_coefficients {
        let b = if k < training.sh_trained { own.basis[k as usize] } else { 0.0 };
        let first = (SH + 3 * k) * n + j;
        *at_mut(gradients, first) = b * own.colour[0];
        *at_mut(gradients, first + n) = b * own.colour[1];
        *at_mut(gradients, first + 2 * n) = b * own.colour[2];
        k += 1;
    }
}
