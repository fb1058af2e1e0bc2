//! The quantiser's step.

use super::fixed::ONE;
use super::lifting::FRACTION;

/// Steps that there are.
pub const STEPS: u8 = 64;

/// A quantiser step of coefficients of unit norm: `2 · 2^(index/8)` levels of 8 bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Step(u8);

/// `2^(i/8)` in 16 binary places.
const EIGHTHS: [u32; 8] = [65_536, 71_468, 77_936, 84_990, 92_682, 101_070, 110_218, 120_194];

impl Step {
    /// The step of an index; the coarsest for one beyond.
    pub fn new(index: u8) -> Step {
        Step(index.min(STEPS - 1))
    }

    /// Index, below [`STEPS`].
    pub fn index(self) -> u8 {
        self.0
    }

    /// Levels of 8 bits.
    pub fn value(self) -> f64 {
        f64::from(EIGHTHS[usize::from(self.0 % 8)] << (self.0 / 8)) / 32_768.0
    }

    /// Steps, with the places of a feature, per lifted unit of a coefficient whose picture has a norm; 16
    /// binary places.
    pub fn per_unit(self, norm: f64) -> i64 {
        // A lifted unit has FRACTION places, a feature as many.
        (norm / self.value() * 65_536.0 + 0.5) as i64
    }

    /// Lifted units per step, 16 binary places.
    pub fn units(self, norm: f64) -> i64 {
        (self.value() / norm * f64::from(1 << (FRACTION + 16)) + 0.5) as i64
    }

    /// Its logarithm as a feature, zero amid the steps in use.
    pub fn log(self) -> i16 {
        ((i32::from(self.0) - 40) * ONE / 8) as i16
    }
}
