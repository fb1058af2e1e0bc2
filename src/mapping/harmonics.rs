//! Real spherical harmonics of degree 0 and 1, signs as in Inria's trainer.

use glam::Vec3;

const C0: f32 = 0.282_094_8;
const C1: f32 = 0.488_602_52;

/// Coefficients of a degree.
pub fn count(degree: u32) -> usize {
    (degree as usize + 1).pow(2)
}

/// Values of the first four basis functions in a unit direction.
pub fn basis(direction: Vec3) -> [f32; 4] {
    [C0, -C1 * direction.y, C1 * direction.z, -C1 * direction.x]
}

/// The coefficient of degree 0 that gives a colour (the renderer adds 0.5).
pub fn constant(colour: Vec3) -> Vec3 {
    (colour - 0.5) / C0
}
