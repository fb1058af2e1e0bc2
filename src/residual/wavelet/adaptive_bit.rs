//! Bits whose chance follows those before them.

use crate::range_coder::{Bits, Probability};

/// Adds up what bits cost.
#[derive(Default)]
pub struct Price(pub f64);

impl Bits for Price {
    fn bit(&mut self, one: Probability, bit: bool) -> bool {
        let one = f64::from(one) / 65_536.0;
        self.0 -= libm::log2(if bit { one } else { 1.0 - one });
        bit
    }
}

/// A kind of bit.
#[derive(Clone, Copy)]
pub struct AdaptiveBit {
    ones: u32,
    all: u32,
}

impl AdaptiveBit {
    /// As if so many of so many had been ones.
    pub const fn new(ones: u32, all: u32) -> AdaptiveBit {
        AdaptiveBit { ones, all }
    }

    /// Codes a bit, and learns from it. Never so sure that the other one takes more than seven bits.
    pub fn code(&mut self, coder: &mut impl Bits, bit: bool) -> bool {
        let chance = 65_536 * u64::from(self.ones) / u64::from(self.all);
        let one = chance.clamp(1 << 9, 65_536 - (1 << 9)) as Probability;
        let bit = coder.bit(one, bit);
        self.ones += u32::from(bit);
        self.all += 1;
        bit
    }
}
