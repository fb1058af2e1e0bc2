//! The mean of tables.

use nvsprior::coder_tables::Tables;

use super::float_networks::{WEIGHTS, quantise, weights_of};

/// The mean of tables by their shares, which add up to one. It has a meaning if all were trained from the same start:
/// the mean keeps most of what each has learnt (Wortsman et al. 2022, robust fine-tuning).
pub fn mean(parts: &[(f32, &Tables)]) -> Tables {
    let mut weights = vec![0.0; WEIGHTS];
    let mut tables = Tables::zero();
    for (share, part) in parts {
        weights.iter_mut().zip(weights_of(part)).for_each(|(sum, weight)| *sum += share * weight);
    }
    quantise(&weights, &mut tables);
    let offset = |place: usize| {
        let of = |part: &Tables| part.offsets.as_flattened().as_flattened()[place];
        parts.iter().map(|(share, part)| share * f32::from(of(part))).sum::<f32>()
    };
    let offsets = tables.offsets.as_flattened_mut().as_flattened_mut();
    for (place, to) in offsets.iter_mut().enumerate() {
        *to = offset(place).round() as i8;
    }
    tables
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_lies_between() {
        let tables = Tables::generic();
        assert_eq!(mean(&[(0.5, &tables), (0.5, &tables)]), tables);
        let half = mean(&[(0.5, &tables), (0.5, &Tables::zero())]);
        for (weight, whole) in weights_of(&half).iter().zip(weights_of(&tables)) {
            assert!((weight - whole / 2.0).abs() < 1e-3, "{weight} {whole}");
        }
        let (half, whole) = (half.offsets[0][1][0], tables.offsets[0][1][0]);
        assert!((2 * i32::from(half) - i32::from(whole)).abs() <= 1);
    }
}
