//! The steps of an update's numbers, and the most that a chain of updates may hold.

use std::ops::RangeInclusive;

/// Learnt splats that a chain may hold at a time.
pub const MAX_LEARNT: usize = 4096;
/// Fades of a whole chain.
pub const MAX_FADES: usize = 256;
/// More bytes than any update has.
pub const MAX_UPDATE_BYTES: usize = 1 << 20;
/// The largest frame number.
pub const MAX_FRAME: u32 = (1 << 24) - 1;
/// Exponents of two of the step of positions.
pub const EXPONENTS: RangeInclusive<i8> = -40..=40;

/// Step of the logarithms of the scales.
pub const LOG_SCALE_STEP: f32 = 0.25;
/// Steps of a quaternion's component from 0 to 1.
pub const ROTATION_STEPS: i8 = 12;
/// Step of the opacities' logits.
pub const LOGIT_STEP: f32 = 0.8;
/// Opacities in steps of their logits: 0.018 to 0.998.
pub const LOGITS: RangeInclusive<i8> = -5..=8;
/// Step of the constant coefficients of the spherical harmonics.
pub const COLOUR_STEP: f32 = 0.12;
/// Fades are counted in cells of so many steps.
pub const CELL_STEPS: i32 = 8;
