//! The twin's picture, and how far rounding and close decisions may move an f32 picture from it.

use glam::DVec3;
use nvsprior::prior::PriorError;
use nvsprior::{Camera, Pose, Prior};
use nvsprior_reference::{Channels, Rendered, Twin};

/// A result may be off by this many times the effect of rounding its inputs, since several operations round.
pub const ROUNDINGS: f64 = 16.0;

pub struct Explained {
    pub picture: Rendered,
    /// How far rounding the inputs moves each channel of each pixel.
    rounding: Vec<Channels>,
    /// Largest value of each channel, at least 1: what errors are relative to.
    scale: Channels,
}

/// How a picture differs from the twin's, relative to the channels' scales.
#[derive(Clone, Debug, Default)]
pub struct Difference {
    pub max: f64,
    pub mean: f64,
    /// Largest change by rounding inputs.
    pub rounding: f64,
    /// Largest difference that is not explained.
    pub excess: f64,
    /// Where that is, and what was found there.
    pub worst: String,
}

impl Explained {
    pub fn new(prior: &Prior, camera: &Camera, pose: &Pose) -> Result<Explained, PriorError> {
        let picture = Twin::new(prior).render(camera, pose);
        let mut rounding = vec![[0.0; 5]; picture.pixels.len()];
        let other = rounded(prior)?;
        let other = Twin::new(&other).with_power_moved().render(camera, &nudged(prior, pose));
        for (to, (a, b)) in rounding.iter_mut().zip(picture.pixels.iter().zip(&other.pixels)) {
            *to = std::array::from_fn(|k| (a[k] - b[k]).abs());
        }
        let largest = |k: usize| picture.pixels.iter().fold(1.0, |m: f64, p| m.max(p[k].abs()));
        let scale = std::array::from_fn(largest);
        Ok(Explained { picture, rounding, scale })
    }

    /// Compares a picture of five floats per pixel.
    pub fn compare(&self, drawn: &[f32]) -> Difference {
        let mut out = Difference::default();
        for (at, pixel) in drawn.chunks_exact(5).enumerate() {
            for (k, value) in pixel.iter().enumerate() {
                let (got, expected) = (f64::from(*value), self.picture.pixels[at][k]);
                let off = (got - expected).abs() / self.scale[k];
                let rounding = self.rounding[at][k] / self.scale[k];
                // Several decisions may depend on each other, so the sum of their jumps is only a guide.
                let risk = self.picture.risk[at][k] / self.scale[k];
                let explained = 1.5 * risk + ROUNDINGS * rounding;
                let excess = if off.is_nan() { f64::INFINITY } else { off - explained };
                out.max = if off.is_nan() { f64::INFINITY } else { out.max.max(off) };
                out.rounding = out.rounding.max(rounding);
                out.mean += off / drawn.len() as f64;
                if excess > out.excess {
                    out.excess = excess;
                    out.worst = format!(
                        "pixel {at}, channel {k}: {got}, twin {expected}, explained {explained:.1e}"
                    );
                }
            }
        }
        out
    }
}

/// Whether f32 and f64 may disagree on which splats lie before the near plane.
pub fn undecided(prior: &Prior, pose: &Pose) -> bool {
    let near = f64::from(prior.options().near);
    let centre = DVec3::from(prior.coordinate_frame().centre.map(f64::from));
    prior.splats().positions.iter().any(|p| {
        let position = DVec3::from(p.map(f64::from));
        let z = (pose.rotation * position + pose.translation).z;
        let held = pose.translation + pose.rotation * centre;
        let size = (position - centre).length() + held.length();
        (z - near).abs() < ROUNDINGS * f64::from(f32::EPSILON) * size
    })
}

/// The prior with every number moved by one unit in the last place, equal numbers in the same way. Positions move by
/// one unit of their distance from the prior's centre if that is more: the device holds them relative to it.
pub fn rounded(prior: &Prior) -> Result<Prior, PriorError> {
    let mut splats = prior.splats().clone();
    let centre = prior.coordinate_frame().centre;
    for position in &mut splats.positions {
        for (v, c) in position.iter_mut().zip(centre) {
            let mut from_centre = *v - c;
            nudge(&mut from_centre);
            nudge(v);
            if c.abs() > v.abs() {
                *v = c + from_centre;
            }
        }
    }
    splats.log_scales.iter_mut().flatten().for_each(nudge);
    splats.rotations.iter_mut().flatten().for_each(nudge);
    splats.opacity_logits.iter_mut().for_each(nudge);
    splats.sh.iter_mut().for_each(nudge);
    Prior::from_splats(splats, *prior.options())
}

/// Moves a number towards zero or from it, by a hash of it.
fn nudge(value: &mut f32) {
    let hash = value.to_bits().wrapping_mul(0x9e37_79b9);
    let up = hash & (1 << 20) == 0;
    // Limits of scales are themselves numbers that priors hold.
    let moved = if up && value.abs() < 39.0 {
        f32::from_bits(value.to_bits() + 1)
    } else {
        f32::from_bits(value.to_bits().saturating_sub(1))
    };
    if *value != 0.0 && moved.is_finite() {
        *value = moved;
    }
}

/// The pose, moved by the rounding of f32, for points relative to the prior's centre.
pub fn nudged(prior: &Prior, pose: &Pose) -> Pose {
    let by = f64::from(f32::EPSILON);
    let mut pose = *pose;
    let centre = DVec3::from(prior.coordinate_frame().centre.map(f64::from));
    let held = pose.translation + pose.rotation * centre;
    pose.translation += held * DVec3::new(by, -by, by);
    pose.stepped(&[0.0, 0.0, 0.0, by, -by, by])
}
