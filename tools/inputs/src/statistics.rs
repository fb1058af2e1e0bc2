//! Medians and high percentiles.

use serde::{Deserialize, Serialize};

/// The middle of some values, and what nearly all stay below.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    pub median: f64,
    /// 95th percentile.
    pub p95: f64,
    pub max: f64,
}

impl Spread {
    /// All NaN if there is no value.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Spread {
        let mut values: Vec<f64> = values.into_iter().collect();
        values.sort_by(f64::total_cmp);
        Spread { median: at(&values, 0.5), p95: at(&values, 0.95), max: at(&values, 1.0) }
    }
}

/// The middle half of some values.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Quartiles {
    #[serde(rename = "first_quartile")]
    pub first: f64,
    pub median: f64,
    #[serde(rename = "third_quartile")]
    pub third: f64,
}

impl Quartiles {
    /// All NaN if there is no value.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Quartiles {
        let mut values: Vec<f64> = values.into_iter().collect();
        values.sort_by(f64::total_cmp);
        let [first, median, third] = [0.25, 0.5, 0.75].map(|share| at(&values, share));
        Quartiles { first, median, third }
    }

    /// Quartiles of values of which more is better. The lower of two middle values counts, since the upper one counts
    /// for errors. So the median PSNR belongs to the trial with the median error.
    pub fn of_gains(values: impl IntoIterator<Item = f64>) -> Quartiles {
        let Quartiles { first, median, third } = Quartiles::of(values.into_iter().map(|v| -v));
        Quartiles { first: -third, median: -median, third: -first }
    }
}

/// The upper median: no value between two is made up.
pub fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    Spread::of(values).median
}

/// The value below which a share of sorted values lies.
pub fn at(sorted: &[f64], share: f64) -> f64 {
    let place = (sorted.len() as f64 * share) as usize;
    sorted.get(place.min(sorted.len().saturating_sub(1))).copied().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spreads_are_values_that_were_there() {
        let spread = Spread::of((0..100).rev().map(f64::from));
        assert_eq!(spread, Spread { median: 50.0, p95: 95.0, max: 99.0 });
        assert_eq!(median([3.0, 1.0]), 3.0);
        assert!(median([]).is_nan());
        let quartiles = Quartiles::of((0..8).rev().map(f64::from));
        assert_eq!(quartiles, Quartiles { first: 2.0, median: 4.0, third: 6.0 });
        let gains = Quartiles::of_gains((0..8).rev().map(f64::from));
        assert_eq!(gains, Quartiles { first: 1.0, median: 3.0, third: 5.0 });
    }
}
