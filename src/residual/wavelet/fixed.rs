//! Logarithms in integers.

use crate::coder_tables::networks::{FEATURE_PLACES, LARGEST};

/// A feature of 1.
pub const ONE: i32 = 1 << FEATURE_PLACES;

/// `64 log2(1 + i/64)`, rounded.
const FRACTIONS: [u8; 64] = [
    0, 1, 3, 4, 6, 7, 8, 10, 11, 12, 13, 15, 16, 17, 18, 19, 21, 22, 23, 24, 25, 26, 27, 28, 29,
    30, 31, 32, 34, 35, 35, 36, 37, 38, 39, 40, 41, 42, 43, 44, 45, 46, 47, 47, 48, 49, 50, 51, 52,
    52, 53, 54, 55, 56, 56, 57, 58, 59, 60, 60, 61, 62, 63, 63,
];

/// `log2` of a number in [`FEATURE_PLACES`] binary places, of one or more; in as many places, to 1/32.
pub const fn log2(value: u32) -> i32 {
    let value = if value < 1 << FEATURE_PLACES { 1 << FEATURE_PLACES } else { value };
    let exponent = value.ilog2() - FEATURE_PLACES;
    let mantissa = (value >> exponent) as usize & 63;
    exponent as i32 * ONE + FRACTIONS[mantissa] as i32
}

/// `log2(1 + |count|)` of a whole number.
pub fn log_count(count: i32) -> i32 {
    if count == 0 {
        return 0;
    }
    log2((1 + count.unsigned_abs().min(1 << 20)) << FEATURE_PLACES)
}

/// `log2(1 + 4|value|)` of a number in [`FEATURE_PLACES`] binary places.
pub fn log_size(value: i32) -> i32 {
    // Most are small.
    match SIZES.get(value.unsigned_abs() as usize) {
        Some(size) => i32::from(*size),
        None => log2(ONE as u32 + 4 * value.unsigned_abs().min(1 << 26)),
    }
}

/// [`log_size`] as an input of the networks.
pub fn size_input(value: i32) -> i16 {
    // None of the small ones is beyond the largest input.
    SIZES.get(value.unsigned_abs() as usize).copied().unwrap_or_else(|| bounded(log_size(value)))
}

/// A number as an input of the networks.
pub fn bounded(value: i32) -> i16 {
    value.clamp(-LARGEST, LARGEST) as i16
}

/// [`log_size`] of the numbers from zero.
static SIZES: [i16; 1024] = {
    let mut sizes = [0; 1024];
    let mut i = 0;
    while i < sizes.len() {
        sizes[i] = log2(ONE as u32 + 4 * i as u32) as i16;
        i += 1;
    }
    sizes
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fractions_are_those_of_the_logarithm() {
        for (i, fraction) in FRACTIONS.iter().enumerate() {
            let exact = 64.0 * (1.0 + i as f64 / 64.0).log2();
            assert_eq!(f64::from(*fraction), exact.round(), "{i}");
        }
    }

    #[test]
    fn logarithms_are_near() {
        for value in (64..100_000u32).step_by(7) {
            let exact = 64.0 * (f64::from(value) / 64.0).log2();
            assert!((f64::from(log2(value)) - exact).abs() < 2.0, "{value}");
        }
        assert_eq!((log_count(0), log_count(-1), log_size(0)), (0, 64, 0));
        assert!(log_size(i32::MIN) < LARGEST * 2 && log_count(i32::MIN) > 0);
        for value in [0, 7, 1023, -1023, 1024, 1 << 20, i32::MIN] {
            assert_eq!(size_input(value), bounded(log_size(value)), "{value}");
        }
    }
}
