//! Stage `train_gradient`: the loss's gradient by all parameters, one invocation per splat that is trained. Training
//! needs it only for checks: stage `train_step` takes its step without writing the gradient down.

use crate::memory::{at, at_mut};
use crate::shared::{Params, sh_coefficients};
use crate::splat_gradient::Gradient;
use crate::train_activate::{Shape, Trained, coefficients};
use crate::training::{LOG_SCALE, NO_PAIR, OPACITY, POSITION, ROTATION, SH, Training};
use spirv_std::glam::{UVec3, Vec4};
use spirv_std::spirv;

/// One invocation per splat.
#[spirv(compute(threads(256)))]
pub fn train_gradient(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(spec_constant(id = 0, default = 3))] sh_degree: u32,
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
    let count = sh_coefficients(sh_degree);
    if at::<u32, _>(starts, training.first_trained + j) == NO_PAIR {
        let mut plane = 0;
        while plane < SH + 3 * count {
            *at_mut(gradients, plane * n + j) = 0.0;
            plane += 1;
        }
        return;
    }
    let shape = Shape::of(training, &Trained::load(training, parameters, j));
    let own =
        Gradient::of(params, training, &shape, parameters, count, records, starts, slots, pairs, j);
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
    coefficients!(k => if k < count {
        let (b, first) = (own.basis[k as usize], (SH + 3 * k) * n + j);
        *at_mut(gradients, first) = b * own.colour[0];
        *at_mut(gradients, first + n) = b * own.colour[1];
        *at_mut(gradients, first + 2 * n) = b * own.colour[2];
    });
}
