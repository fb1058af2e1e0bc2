//! Numbers that look random and are the same for the same seed: SplitMix64 (Steele, Lea & Flood 2014).

const STEP: u64 = 0x9e37_79b9_7f4a_7c15;

/// A sequence of numbers.
#[derive(Clone, Debug)]
pub struct Random(u64);

impl Random {
    /// The sequence of a seed.
    pub fn new(seed: u64) -> Random {
        Random(seed)
    }

    /// The sequence of seed 0 from its number `place` on; the first has place 1.
    pub fn at(place: u64) -> Random {
        Random(place.wrapping_sub(1).wrapping_mul(STEP))
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(STEP);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in [−1, 1).
    pub fn even(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    /// Uniform in `[low, high)`.
    pub fn within(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * (self.bits() >> 40) as f32 / (1 << 24) as f32
    }

    /// Three numbers, uniform in `[low, high)`.
    pub fn triple(&mut self, low: f32, high: f32) -> [f32; 3] {
        std::array::from_fn(|_| self.within(low, high))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sequence_is_splitmix64() {
        let mut random = Random::new(1_234_567);
        // The reference implementation's first numbers.
        let expected = [6_457_827_717_110_365_317, 3_203_168_211_198_807_973];
        assert_eq!([random.bits(), random.bits()], expected);
    }

    #[test]
    fn a_place_is_that_of_seed_zero() {
        let mut random = Random::new(0);
        let third = [(); 3].map(|()| random.bits())[2];
        assert_eq!(Random::at(3).bits(), third);
    }

    #[test]
    fn numbers_stay_within_their_bounds() {
        let mut random = Random::new(5);
        for _ in 0..1000 {
            assert!((-1.0..1.0).contains(&random.even()));
            assert!((2.0..3.0).contains(&random.within(2.0, 3.0)));
        }
    }
}
