//! Splats as whole numbers, and back.
//!
//! Only additions, products, quotients and square roots of f64 are used. Every machine rounds these in the same way: a
//! file gives the same splats, and the same identity, everywhere.

use super::super::fault::{INFINITE_LOGIT, MAX_LOG_SCALE};
use super::super::orientation;
use super::super::{CoordinateFrame, PriorError, Splats};

/// How coarsely a prior is written: the steps of its parameters. Errors are up to half a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quantisation {
    /// Step of positions, as a share of the prior's spread ([`CoordinateFrame::unit`]), rounded down to a power of two
    /// of the prior's unit. Far from the centre steps are coarser: see [`UNIFORM_BITS`].
    pub position: f32,
    /// Step of the logarithms of the scales.
    pub log_scale: f32,
    /// Step of the components of unit quaternions.
    pub rotation: f32,
    /// Step of the logits of the opacities.
    pub opacity_logit: f32,
    /// Step of the constant coefficients of the spherical harmonics.
    pub colour: f32,
    /// Step of the other coefficients of the spherical harmonics.
    pub sh: f32,
}

impl Default for Quantisation {
    fn default() -> Quantisation {
        Quantisation {
            position: 1.0 / 4096.0,
            log_scale: 0.06,
            rotation: 0.007,
            opacity_logit: 0.08,
            colour: 0.04,
            sh: 0.05,
        }
    }
}

impl Quantisation {
    /// Multiplies all steps by `factor`: above 1 for smaller files, below 1 for better pictures.
    pub fn scaled(&self, factor: f32) -> Quantisation {
        Quantisation {
            position: self.position * factor,
            log_scale: self.log_scale * factor,
            rotation: self.rotation * factor,
            opacity_logit: self.opacity_logit * factor,
            colour: self.colour * factor,
            sh: self.sh * factor,
        }
    }

    /// The steps with their names.
    pub(super) fn steps(&self) -> [(&'static str, f32); 6] {
        [
            ("position", self.position),
            ("log_scale", self.log_scale),
            ("rotation", self.rotation),
            ("opacity_logit", self.opacity_logit),
            ("colour", self.colour),
            ("sh", self.sh),
        ]
    }

    /// Checks that every step is at least 1e-6 and at most 1 (rotations: 1/8).
    pub fn check(&self) -> Result<(), PriorError> {
        for (name, step) in self.steps() {
            let max = if name == "rotation" { 0.125 } else { 1.0 };
            if !(step >= 1e-6 && step <= max) {
                return Err(PriorError::Step { name, step, max });
            }
        }
        Ok(())
    }
}

/// Up to 2²⁰ steps from the origin, steps of a position are even. From there on they double with each doubling of the
/// distance. So any f32 can be written, to 2⁻²¹ of its distance or better.
pub const UNIFORM_BITS: u32 = 20;

/// Where positions are counted from, and in which steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// The prior's unit.
    pub origin: [f32; 3],
    /// The step is two to the power of this, in the prior's unit; −149 (the limit of f32) to 127.
    pub exponent: i16,
}

impl Grid {
    pub const EXPONENTS: std::ops::RangeInclusive<i16> = -149..=127;

    /// The grid for splats at `positions`, at least one, with steps of about `share` of their
    /// spread. If the positions already lie on a grid near that one, it is taken, so that writing a
    /// second time changes nothing.
    pub fn of(positions: &[[f32; 3]], share: f32) -> Grid {
        let frame = CoordinateFrame::of(positions);
        let far = frame.centre.iter().fold(0.0, |far: f32, v| far.max(v.abs()));
        let step = (frame.unit() * f64::from(share)).max(f64::from(far) * 2_f64.powi(-20));
        let exponent = exponent_of(step).clamp(-148, 126);
        // The origin is the median itself, which stays in place. So the next writing finds the same origin, and the
        // same order.
        let grid = |exponent: i32| Grid { origin: frame.centre, exponent: exponent as i16 };
        let keeps = |grid: &Grid| positions.iter().all(|p| grid.position(grid.code(*p)) == *p);
        let near = [0, 1, -1].map(|more| grid(exponent + more));
        near.into_iter().find(keeps).unwrap_or(near[0])
    }

    fn step(&self) -> f64 {
        power_of_two(self.exponent.into())
    }

    /// A finite position in steps from the origin, below 2²⁹ each.
    pub fn code(&self, position: [f32; 3]) -> [i32; 3] {
        std::array::from_fn(|axis| {
            let offset = (f64::from(position[axis]) - f64::from(self.origin[axis])) / self.step();
            let near = offset.abs().round();
            // From 2²⁰ on a number has 2²⁰ codes to each power of two.
            let octave = (exponent_of(near.max(1.0)) - UNIFORM_BITS as i32).max(0);
            let mantissa = (offset.abs() / power_of_two(octave)).round() as i32;
            let code = (octave << UNIFORM_BITS) + mantissa;
            if offset < 0.0 { -code } else { code }
        })
    }

    /// The position of a code; not finite if it lies beyond the range of f32.
    pub fn position(&self, code: [i32; 3]) -> [f32; 3] {
        std::array::from_fn(|axis| {
            let magnitude = code[axis].unsigned_abs();
            let octave = (magnitude >> UNIFORM_BITS).saturating_sub(1);
            let mantissa = magnitude - (octave << UNIFORM_BITS);
            let offset = f64::from(mantissa) * power_of_two(octave as i32) * self.step();
            (f64::from(self.origin[axis]) + offset.copysign(f64::from(code[axis]))) as f32
        })
    }
}

/// 2 to the power of −1022 to 1023.
fn power_of_two(exponent: i32) -> f64 {
    f64::from_bits(((1023 + exponent.clamp(-1022, 1023)) as u64) << 52)
}

/// The exponent of the power of two at or below a positive normal number.
fn exponent_of(value: f64) -> i32 {
    ((value.to_bits() >> 52) & 0x7ff) as i32 - 1023
}

/// Columns of a splat besides its position.
pub const SCALE: usize = 0;
pub const ROTATION: usize = 3;
pub const LOGIT: usize = 6;
pub const COLOUR: usize = 7;

/// Number of columns: scales, rotation, opacity, spherical harmonics.
pub fn columns(sh_degree: u32) -> usize {
    COLOUR + 3 * (sh_degree as usize + 1).pow(2)
}

/// Largest magnitude of a value in steps: up to this an f32 tells neighbouring steps apart.
const MAX_CODE: f64 = (1 << 22) as f64;

/// Splat `index` in steps, column by column. The splat must be valid. Fails if a value is too large
/// for its step.
pub fn quantise(splats: &Splats, index: usize, q: &Quantisation) -> Result<Vec<i32>, PriorError> {
    let steps = |value: f32, step: f32| (f64::from(value) / f64::from(step)).round();
    let whole = |column, value: f32, step| {
        let code = steps(value, step);
        match code.abs() <= MAX_CODE {
            true => Ok(code as i32),
            false => Err(PriorError::OutOfSteps { splat: index, column, value, step }),
        }
    };
    let max = (f64::from(MAX_LOG_SCALE) / f64::from(q.log_scale)).floor();
    let scales = splats.log_scales[index];
    let scales = scales.map(|s| steps(s, q.log_scale).clamp(-max, max) as i32);
    let (scales, rotation) = orientation::reduced(splats.unit_rotation(index), scales, q.rotation);
    let mut codes = Vec::with_capacity(columns(splats.sh_degree));
    codes.extend(scales);
    codes.extend(rotation);
    let logit = splats.opacity_logits[index].clamp(-INFINITE_LOGIT, INFINITE_LOGIT);
    codes.push(whole("opacity", logit, q.opacity_logit)?);
    let stride = splats.sh_stride();
    let sh = &splats.sh[index * stride..(index + 1) * stride];
    for (coefficient, rgb) in sh.chunks_exact(3).enumerate() {
        let step = if coefficient == 0 { q.colour } else { q.sh };
        let [r, g, b] = [rgb[0], rgb[1], rgb[2]].map(|v| whole("spherical harmonics", v, step));
        let (r, g, b) = (r?, g?, b?);
        codes.extend([g, r - g, b - g]);
    }
    Ok(codes)
}

/// Appends the splat of a position and the codes of its columns.
pub fn dequantise(splats: &mut Splats, position: [f32; 3], codes: &[i32], q: &Quantisation) {
    let value = |code: i32, step: f32| (f64::from(code) * f64::from(step)) as f32;
    splats.positions.push(position);
    splats.log_scales.push([0, 1, 2].map(|axis| value(codes[SCALE + axis], q.log_scale)));
    let rotation = [0, 1, 2].map(|axis| codes[ROTATION + axis]);
    splats.rotations.push(orientation::quaternion(rotation, q.rotation));
    splats.opacity_logits.push(value(codes[LOGIT], q.opacity_logit));
    for (coefficient, c) in codes[COLOUR..].chunks_exact(3).enumerate() {
        let step = if coefficient == 0 { q.colour } else { q.sh };
        let rgb = [c[0].wrapping_add(c[1]), c[0], c[0].wrapping_add(c[2])];
        splats.sh.extend(rgb.map(|code| value(code, step)));
    }
}
