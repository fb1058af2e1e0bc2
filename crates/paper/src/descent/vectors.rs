//! Vectors of a pose step: three of translation, three of rotation.

use nvsprior::tracking::Objective;

pub(super) fn dot(a: &[f64; 6], b: &[f64; 6]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

pub(super) fn scaled(a: &[f64; 6], factor: f64) -> [f64; 6] {
    a.map(|v| v * factor)
}

/// Turns a step whose translation is in units of `length` into one in the prior's unit. Also turns a gradient with
/// respect to the second into one with respect to the first.
pub(super) fn moved_in(length: f64, step: &[f64; 6]) -> [f64; 6] {
    std::array::from_fn(|i| if i < 3 { step[i] * length } else { step[i] })
}

pub(super) fn minus(a: &[f64; 6], b: &[f64; 6]) -> [f64; 6] {
    std::array::from_fn(|i| a[i] - b[i])
}

/// Largest absolute component; a NaN counts as infinite.
pub(super) fn norm_max(a: &[f64; 6]) -> f64 {
    a.iter().fold(0.0, |m: f64, v| if v.is_nan() { f64::INFINITY } else { m.max(v.abs()) })
}

/// The length that makes translations comparable with turns: the prior's own.
pub(super) fn length(objective: &mut Objective) -> f64 {
    objective.renderer().scene().coordinate_frame().unit()
}
