//! Starts moved off at random, the same in every run.

use nvsprior::geometry::Twist;
use nvsprior::random::Random;

/// How far starts are moved off, along and about each axis: uniform in both directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Magnitude {
    /// Along each axis, the prior's unit.
    pub units: f64,
    /// About each axis, degrees.
    pub degrees: f64,
}

/// The paper's bounds for its public data sets.
pub const NEAR: Magnitude = Magnitude { units: 0.11, degrees: 3.0 };
/// Three times as far.
pub const FAR: Magnitude = Magnitude { units: 0.3, degrees: 10.0 };

/// A start has failed if its picture stays this much below that of the best known pose, dB.
pub const SHORT: f64 = 0.1;

/// The endless sequence of steps of a seed, to apply to the best known poses.
pub fn steps(magnitude: Magnitude, seed: u64) -> impl Iterator<Item = Twist> {
    let mut even = even(seed);
    let Magnitude { units, degrees } = magnitude;
    let limits = [units, units, units].into_iter().chain([degrees.to_radians(); 3]);
    std::iter::repeat_with(move || {
        let mut step = [0.0; 6];
        for (value, limit) in step.iter_mut().zip(limits.clone()) {
            *value = limit * even.next().unwrap_or_default();
        }
        step
    })
}

/// The endless sequence of a seed, uniform in [−1, 1).
pub fn even(seed: u64) -> impl Iterator<Item = f64> {
    let mut random = Random::new(seed);
    std::iter::repeat_with(move || random.even())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_even_within_their_bounds_and_the_same_again() {
        let drawn: Vec<Twist> = steps(FAR, 7).take(1000).collect();
        assert_eq!(drawn, steps(FAR, 7).take(1000).collect::<Vec<_>>());
        assert_ne!(drawn, steps(FAR, 8).take(1000).collect::<Vec<_>>());
        for axis in 0..6 {
            let limit = if axis < 3 { FAR.units } else { FAR.degrees.to_radians() };
            let values = || drawn.iter().map(|step| step[axis] / limit);
            assert!(values().all(|v| (-1.0..1.0).contains(&v)));
            let (mean, square) =
                values().fold((0.0, 0.0), |(m, s), v| (m + v / 1e3, s + v * v / 1e3));
            assert!(mean.abs() < 0.1 && (square - 1.0 / 3.0).abs() < 0.05, "{mean} {square}");
        }
    }
}
