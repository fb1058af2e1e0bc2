//! Where splats are needed: those that show nothing move to where others show much, and some are added, so that the
//! picture stays as it is (3DGS-MCMC, Kheradmand et al. 2024, eq. 9).

use crate::trainer::TrainingState;
use nvsprior::random::Random;
use nvsprior_kernels::training::{LOG_SCALE, OPACITY, POSITION};
use rayon::prelude::*;

use super::splats::Planes;

/// Splats of less opacity move.
const FAINT: f64 = 0.005;
/// Most splats that one is divided into.
const MAX_COPIES: usize = 51;

/// Moves faint splats of the first `alive` of `n`, and adds a share of them; how many are alive then. `weights`: how
/// much each of the first ones is to be divided beside its opacity; all alike without them.
pub fn relocate(
    state: &mut TrainingState,
    n: u32,
    alive: u32,
    growth: f64,
    weights: Option<&[f32]>,
    random: &mut Random,
) -> u32 {
    let splats = n as usize;
    let opacities: Vec<f64> = {
        let logits = &state.parameters[OPACITY as usize * splats..][..alive as usize];
        logits.iter().map(|logit| 1.0 / (1.0 + (-f64::from(*logit)).exp())).collect()
    };
    let grown = (f64::from(alive) * (1.0 + growth)) as u32;
    let faint = (0..alive as usize).filter(|i| opacities[*i] <= FAINT);
    let free: Vec<usize> = faint.chain(alive as usize..grown.min(n) as usize).collect();
    let Some(choice) = ByOpacity::new(&opacities, weights) else { return alive };
    // By the splat that is divided: those that it is divided into.
    let mut shares = vec![Vec::new(); alive as usize];
    for to in free {
        shares[choice.draw(random)].push(to);
    }
    for (from, into) in shares.iter().enumerate().filter(|(_, into)| !into.is_empty()) {
        divide(state, splats, from, into, opacities[from]);
    }
    grown.min(n).max(alive)
}

/// Sorts the first `alive` splats by how large the cameras see them, the largest first. A stage of the device waits for
/// the largest of neighbouring splats, so neighbours should be alike. `extent`: that of the cameras, around the origin.
pub fn sort_by_size(state: &mut TrainingState, splats: usize, alive: usize, extent: f32) {
    let parameters = &state.parameters;
    let at = |plane: u32, i: usize| parameters[plane as usize * splats + i];
    let size = |i: usize| {
        let log_scale = (0..3).map(|k| at(LOG_SCALE + k, i)).fold(f32::NEG_INFINITY, f32::max);
        let distance = (0..3).map(|k| at(POSITION + k, i).powi(2)).sum::<f32>().sqrt();
        log_scale - (distance + extent).ln()
    };
    let sizes: Vec<f32> = (0..alive).map(size).collect();
    let mut order: Vec<usize> = (0..alive).collect();
    order.sort_by(|a, b| sizes[*b].total_cmp(&sizes[*a]));
    let TrainingState { parameters, first, second } = state;
    for numbers in [parameters, first, second] {
        numbers.par_chunks_exact_mut(splats).for_each(|plane| {
            let sorted: Vec<f32> = order.iter().map(|i| plane[*i]).collect();
            plane[..alive].copy_from_slice(&sorted);
        });
    }
}

/// A splat chosen by its opacity and weight.
struct ByOpacity {
    /// Sums of the opacities up to each.
    sums: Vec<f64>,
}

impl ByOpacity {
    /// Among those that are not faint; `None` if all are.
    fn new(opacities: &[f64], weights: Option<&[f32]>) -> Option<ByOpacity> {
        let mut sum = 0.0;
        let weight = |i: usize| weights.map_or(1.0, |weights| f64::from(weights[i]));
        let sums: Vec<f64> = (0..)
            .zip(opacities)
            .map(|(i, opacity)| {
                sum += if *opacity > FAINT { *opacity * weight(i) } else { 0.0 };
                sum
            })
            .collect();
        (sum > 0.0).then_some(ByOpacity { sums })
    }

    fn draw(&self, random: &mut Random) -> usize {
        let total = self.sums.last().copied().unwrap_or(0.0);
        let point = total * (random.bits() >> 11) as f64 / (1_u64 << 53) as f64;
        self.sums.partition_point(|sum| *sum <= point).min(self.sums.len() - 1)
    }
}

/// Divides a splat: itself and those in `into` together show what it shows.
fn divide(state: &mut TrainingState, splats: usize, from: usize, into: &[usize], opacity: f64) {
    let (share, scale) = divided(opacity, into.len() + 1);
    let share = share.clamp(FAINT, 1.0 - 1e-6);
    let TrainingState { parameters, first, second } = state;
    let mut planes = Planes { numbers: parameters, splats };
    *planes.at(OPACITY, from) = (share / (1.0 - share)).ln() as f32;
    for k in 0..3 {
        *planes.at(LOG_SCALE + k, from) += scale.ln() as f32;
    }
    for to in into {
        planes.copy(from, *to);
    }
    for numbers in [first, second] {
        let mut planes = Planes { numbers, splats };
        into.iter().chain([&from]).for_each(|splat| planes.clear(*splat));
    }
}

/// Opacity, and factor of the standard deviations, of each of `count` splats that stand for one.
fn divided(opacity: f64, count: usize) -> (f64, f64) {
    let count = count.min(MAX_COPIES);
    let share = 1.0 - (1.0 - opacity).powf(1.0 / count as f64);
    let mut sum = 0.0;
    for i in 1..=count {
        let mut binomial = 1.0;
        for k in 0..i {
            let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
            sum += binomial * sign / ((k + 1) as f64).sqrt() * share.powi(k as i32 + 1);
            binomial *= (i - 1 - k) as f64 / (k + 1) as f64;
        }
    }
    (share, opacity / sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Seen along a line through the middle, the integral of alpha stays.
    #[test]
    fn divided_splats_show_what_the_one_showed() {
        let covered = |opacity: f64, scale: f64, count: i32| -> f64 {
            let alpha = |x: f64| opacity * (-0.5 * (x / scale).powi(2)).exp();
            (-4000..4000).map(|i| 1.0 - (1.0 - alpha(f64::from(i) * 0.005)).powi(count)).sum()
        };
        for opacity in [0.01, 0.3, 0.9, 0.99] {
            for count in [1, 2, 5, 20] {
                let (share, scale) = divided(opacity, count);
                let (one, all) = (covered(opacity, 1.0, 1), covered(share, scale, count as i32));
                assert!((all / one - 1.0).abs() < 0.01, "{opacity} by {count}: {all} for {one}");
            }
        }
    }

    #[test]
    fn faint_splats_move_and_the_number_grows() {
        let n = 100;
        let numbers = 14 * n;
        let mut state = TrainingState {
            parameters: vec![0.5; numbers],
            first: vec![1.0; numbers],
            second: vec![1.0; numbers],
        };
        for i in 40..50 {
            state.parameters[OPACITY as usize * n + i] = -9.0;
        }
        let alive = relocate(&mut state, n as u32, 60, 0.05, None, &mut Random::new(1));
        assert_eq!(alive, 63);
        let logits = &state.parameters[OPACITY as usize * n..][..63];
        assert!(logits.iter().all(|logit| *logit > -5.4), "{logits:?}");
        assert_eq!(state.first[OPACITY as usize * n + 45], 0.0);
    }

    #[test]
    fn only_splats_of_some_weight_are_divided() {
        let n = 100;
        let mut state = TrainingState {
            parameters: (0..14 * n).map(|i| (i % n) as f32 * 0.01).collect(),
            first: vec![1.0; 14 * n],
            second: vec![1.0; 14 * n],
        };
        let before = state.clone();
        let weights: Vec<f32> = (0..60).map(|i| if i == 7 { 0.2 } else { 0.0 }).collect();
        let mut random = Random::new(1);
        let alive = relocate(&mut state, n as u32, 60, 0.05, Some(&weights), &mut random);
        assert_eq!(alive, 63);
        for plane in 0..3 {
            let own = &state.parameters[plane * n..][..63];
            assert_eq!(own[..60], before.parameters[plane * n..][..60]);
            assert_eq!(own[60..], [0.07; 3]);
        }
        let mut other = before.clone();
        let alive = relocate(&mut other, n as u32, 60, 0.05, Some(&[0.0; 60]), &mut random);
        assert_eq!((alive, other == before), (60, true));
    }

    #[test]
    fn the_largest_come_first_with_all_their_numbers() {
        let n = 9;
        let plane = |p: usize| (0..n).map(move |i| (100 * p + i) as f32);
        let mut state = TrainingState {
            parameters: (0..14).flat_map(plane).collect(),
            first: (20..34).flat_map(plane).collect(),
            second: (40..54).flat_map(plane).collect(),
        };
        // All in one place; sizes rise with the number.
        state.parameters[..3 * n].fill(0.0);
        sort_by_size(&mut state, n, 6, 1.0);
        for (numbers, first) in [(&state.parameters, 0), (&state.first, 20), (&state.second, 40)] {
            let own: Vec<f32> = numbers[6 * n..7 * n].to_vec();
            let expected = [5, 4, 3, 2, 1, 0, 6, 7, 8].map(|i| (100 * (first + 6) + i) as f32);
            assert_eq!(own, expected);
        }
    }
}
