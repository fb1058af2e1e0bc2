//! Numbers as bits whose chances adapt to the numbers before.
//!
//! One function describes both ways: a writer takes the number that it is given, a reader gives the one that it finds.

use crate::range_coder::{Bits, EVEN, Probability};

/// The chance of a bit, from the bits before it in the same place.
#[derive(Clone, Copy)]
pub struct Chance {
    one: Probability,
    /// Bits seen, up to [`SLOWEST`].
    seen: u16,
}

/// A chance moves towards a bit by one part in the number of bits seen, but at least by one part in so many.
const SLOWEST: u16 = 120;
/// No chance comes closer to 0 or 1, parts of 65,536.
const LEAST: i32 = 300;

impl Chance {
    /// A chance that counts as if it came from `seen` bits.
    pub const fn of(one: Probability, seen: u16) -> Chance {
        Chance { one, seen }
    }

    pub fn code(&mut self, coder: &mut impl Bits, bit: bool) -> bool {
        let bit = coder.bit(self.one, bit);
        let (one, target) = (i32::from(self.one), if bit { 65_536 } else { 0 });
        // After Krichevsky and Trofimov: half a bit of each kind counts as seen.
        let moved = one + 2 * (target - one) / (2 * i32::from(self.seen) + 4);
        self.one = moved.clamp(LEAST, 65_536 - LEAST) as Probability;
        self.seen = (self.seen + 1).min(SLOWEST);
        bit
    }
}

/// Numbers, the smaller the likelier: the number of their digits, then the digits.
#[derive(Clone)]
pub struct Magnitude {
    more: [Chance; 33],
    second: [Chance; 33],
}

impl Magnitude {
    pub const fn new() -> Magnitude {
        Magnitude { more: [Chance::of(EVEN, 1); 33], second: [Chance::of(EVEN, 1); 33] }
    }

    pub fn code(&mut self, coder: &mut impl Bits, value: u32) -> u32 {
        let value = u64::from(value) + 1;
        let mut digits = 0;
        while digits < 32 && self.more[digits].code(coder, value >> (digits + 1) != 0) {
            digits += 1;
        }
        let mut read = 1_u64;
        for place in (0..digits).rev() {
            let bit = value >> place & 1 != 0;
            let first = place + 1 == digits;
            let bit =
                if first { self.second[digits].code(coder, bit) } else { coder.bit(EVEN, bit) };
            read = read << 1 | u64::from(bit);
        }
        (read - 1) as u32
    }
}

/// Whole numbers around zero: whether it is zero, its sign, then its size.
#[derive(Clone)]
pub struct Signed {
    zero: Chance,
    size: Size,
}

impl Signed {
    /// Numbers of which most are below `usual`.
    pub const fn new(usual: u32) -> Signed {
        let zero = Chance::of((65_536 / (2 * usual + 1)) as Probability, 4);
        Signed { zero, size: Size::new(usual) }
    }

    pub fn code(&mut self, coder: &mut impl Bits, value: i32) -> i32 {
        if self.zero.code(coder, value == 0) {
            return 0;
        }
        let negative = coder.bit(EVEN, value < 0);
        self.size.code(coder, value, negative)
    }
}

/// Sizes of whole numbers that are not zero: in unary; from 16 on by their digits.
#[derive(Clone)]
pub struct Size {
    more: [Chance; Size::UNARY as usize],
    beyond: Magnitude,
}

impl Size {
    const UNARY: u32 = 16;

    /// Numbers of which most are below `usual`.
    pub const fn new(usual: u32) -> Size {
        let more = 65_536 * usual / (usual + 1);
        Size {
            more: [Chance::of(more as Probability, 4); Size::UNARY as usize],
            beyond: Magnitude::new(),
        }
    }

    /// Codes a number whose sign is coded, and returns it.
    pub fn code(&mut self, coder: &mut impl Bits, value: i32, negative: bool) -> i32 {
        let above = value.unsigned_abs().wrapping_sub(1);
        let mut read = 0;
        while read < Size::UNARY && self.more[read as usize].code(coder, above > read) {
            read += 1;
        }
        if read == Size::UNARY {
            read = read.wrapping_add(self.beyond.code(coder, above.wrapping_sub(read)));
        }
        let magnitude = read.wrapping_add(1) as i32;
        if negative { magnitude.wrapping_neg() } else { magnitude }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use crate::range_coder::{RangeEncoder, WholeReader};

    use super::*;

    fn written(code: impl Fn(&mut RangeEncoder)) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = RangeEncoder::new(&mut bytes, usize::MAX);
        code(&mut encoder);
        encoder.finish();
        bytes
    }

    fn values() -> impl Strategy<Value = Vec<i32>> {
        let value =
            prop_oneof![-3_i32..4, -40_i32..40, any::<i32>(), Just(i32::MIN), Just(i32::MAX)];
        proptest::collection::vec(value, 0..80)
    }

    proptest! {
        #[test]
        fn numbers_come_back(values in values()) {
            let models = || (Signed::new(2), Magnitude::new());
            let bytes = written(|coder| {
                let (mut signed, mut magnitude) = models();
                for value in &values {
                    signed.code(coder, *value);
                    magnitude.code(coder, value.cast_unsigned());
                }
            });
            let mut reader = WholeReader::new(&bytes);
            let (mut signed, mut magnitude) = models();
            for value in values {
                prop_assert_eq!(signed.code(&mut reader, 0), value);
                prop_assert_eq!(magnitude.code(&mut reader, 0), value.cast_unsigned());
            }
        }
    }

    #[test]
    fn chances_adapt() {
        let bytes = written(|coder| {
            let mut chance = Chance::of(EVEN, 0);
            for _ in 0..1000 {
                chance.code(coder, true);
            }
        });
        assert!(bytes.len() < 12, "{} bytes for a thousand bits that are alike", bytes.len());
    }
}
