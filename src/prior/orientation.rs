//! One of the 24 rotations that stand for a splat.
//!
//! A Gaussian stays the same if its axes are renamed: it is turned by right angles, and its scales
//! are swapped to match. This gives 24 rotations, and the smallest is written. Its w is at least
//! 0.85, so x, y and z are enough and lie within ±0.53: one part in 24 of all rotations.

use std::f64::consts::FRAC_1_SQRT_2 as H;

use glam::{DQuat, DVec3};

/// Scales and x, y, z in steps of a unit quaternion (w, x, y, z), with the axes renamed so that the rotation is the
/// smallest. A rotation that is the smallest up to rounding stays, so that what was written once is written the same
/// again.
pub fn reduced(rotation: [f32; 4], scales: [i32; 3], step: f32) -> ([i32; 3], [i32; 3]) {
    let [w, x, y, z] = rotation.map(f64::from);
    let q = DQuat::from_xyzw(x, y, z, w);
    let [w, x, y, z] = quaternion(steps(q, step), step).map(f64::from);
    let rounded = DQuat::from_xyzw(x, y, z, w);
    // Rounding turns a quaternion by up to a step, so the w of two quaternions may come two steps closer.
    if w >= (rounded * smallest(rounded)).w.abs() - 2.5 * f64::from(step) {
        return (scales, steps(q, step));
    }
    let (scales, q) = renamed(scales, q);
    (scales, steps(q, step))
}

/// The smallest rotation, with scales to match.
pub fn renamed(scales: [i32; 3], q: DQuat) -> ([i32; 3], DQuat) {
    let turn = smallest(q);
    let named = DVec3::AXES.map(|axis| {
        let axis = (turn * axis).abs();
        scales[if axis.x > 0.5 { 0 } else { 1 + usize::from(axis.z > 0.5) }]
    });
    (named, q * turn)
}

/// The unit quaternion (w, x, y, z) of x, y, z in steps.
pub fn quaternion(steps: [i32; 3], step: f32) -> [f32; 4] {
    let [x, y, z] = steps.map(|v| f64::from(v) * f64::from(step));
    let w = (1.0 - x * x - y * y - z * z).max(0.0).sqrt();
    [w, x, y, z].map(|v| v as f32)
}

/// x, y, z in steps of the quaternion, or of the opposite one, whose w is not negative.
fn steps(q: DQuat, step: f32) -> [i32; 3] {
    let sign = 1_f64.copysign(q.w);
    [q.x, q.y, q.z].map(|v| (sign * v / f64::from(step)).round() as i32)
}

/// The turn of the axes after which the rotation is the smallest.
fn smallest(q: DQuat) -> DQuat {
    let w = |turn: &DQuat| (q * *turn).w.abs();
    let mut best = TURNS[0];
    for turn in &TURNS[1..] {
        if w(turn) > w(&best) {
            best = *turn;
        }
    }
    best
}

const fn turn(w: f64, x: f64, y: f64, z: f64) -> DQuat {
    DQuat::from_xyzw(x, y, z, w)
}

/// The rotations of a cube.
const TURNS: [DQuat; 24] = [
    turn(1.0, 0.0, 0.0, 0.0),
    turn(0.0, 1.0, 0.0, 0.0),
    turn(0.0, 0.0, 1.0, 0.0),
    turn(0.0, 0.0, 0.0, 1.0),
    turn(H, H, 0.0, 0.0),
    turn(H, -H, 0.0, 0.0),
    turn(H, 0.0, H, 0.0),
    turn(H, 0.0, -H, 0.0),
    turn(H, 0.0, 0.0, H),
    turn(H, 0.0, 0.0, -H),
    turn(0.0, H, H, 0.0),
    turn(0.0, H, -H, 0.0),
    turn(0.0, H, 0.0, H),
    turn(0.0, H, 0.0, -H),
    turn(0.0, 0.0, H, H),
    turn(0.0, 0.0, H, -H),
    turn(0.5, 0.5, 0.5, 0.5),
    turn(0.5, 0.5, 0.5, -0.5),
    turn(0.5, 0.5, -0.5, 0.5),
    turn(0.5, 0.5, -0.5, -0.5),
    turn(0.5, -0.5, 0.5, 0.5),
    turn(0.5, -0.5, 0.5, -0.5),
    turn(0.5, -0.5, -0.5, 0.5),
    turn(0.5, -0.5, -0.5, -0.5),
];
