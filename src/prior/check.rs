//! Which splats a renderer can use. The others are dropped when the prior is loaded, and counted.

use std::fmt;

use super::fault::{Fault, INFINITE_LOGIT, MAX_COEFFICIENT, MAX_LOG_SCALE, MIN_QUATERNION};
use super::splats::{Splats, quaternion_length};

/// Splats dropped for one reason.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Dropped {
    /// The reason.
    pub fault: Fault,
    /// How many splats.
    pub count: usize,
    /// Index, as read, of the first one.
    pub first: usize,
}

impl fmt::Display for Dropped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Dropped { fault, count, first } = self;
        write!(f, "{count} splats dropped, first splat {first}: {fault}")
    }
}

/// Replaces infinite opacity logits by ±[`INFINITE_LOGIT`]. Returns how many there were.
pub(super) fn clamp_logits(splats: &mut Splats) -> usize {
    let infinite = splats.opacity_logits.iter_mut().filter(|logit| logit.is_infinite());
    infinite.map(|logit| *logit = INFINITE_LOGIT.copysign(*logit)).count()
}

/// Replaces scales of zero, whose logarithms are −∞, by the least ones. Returns how many splats are flat.
pub(super) fn flatten(splats: &mut Splats) -> usize {
    let mut flat = 0;
    for scales in &mut splats.log_scales {
        scales.iter_mut().filter(|s| **s == f32::NEG_INFINITY).for_each(|s| *s = -MAX_LOG_SCALE);
        flat += usize::from(scales.contains(&-MAX_LOG_SCALE));
    }
    flat
}

/// Drops invalid splats from `splats`, whose arrays must agree. Returns which, ordered by first index.
pub(super) fn drop_invalid(splats: &mut Splats) -> Vec<Dropped> {
    let faults: Vec<Option<Fault>> = (0..splats.len()).map(|i| fault_of(splats, i)).collect();
    let mut dropped: Vec<Dropped> = Fault::ALL
        .into_iter()
        .filter_map(|fault| {
            let first = faults.iter().position(|f| *f == Some(fault))?;
            let count = faults.iter().filter(|f| **f == Some(fault)).count();
            Some(Dropped { fault, count, first })
        })
        .collect();
    dropped.sort_by_key(|d| d.first);
    if !dropped.is_empty() {
        let stride = splats.sh_stride();
        keep(&mut splats.positions, &faults, 1);
        keep(&mut splats.log_scales, &faults, 1);
        keep(&mut splats.rotations, &faults, 1);
        keep(&mut splats.opacity_logits, &faults, 1);
        keep(&mut splats.sh, &faults, stride);
    }
    dropped
}

/// Keeps the entries of splats without a fault; each splat has `stride` of them.
fn keep<T>(array: &mut Vec<T>, faults: &[Option<Fault>], stride: usize) {
    let mut index = 0;
    array.retain(|_| {
        index += 1;
        faults[(index - 1) / stride].is_none()
    });
}

/// What is wrong with splat `index`.
pub(super) fn fault_of(splats: &Splats, index: usize) -> Option<Fault> {
    let scales = &splats.log_scales[index];
    let rotation = splats.rotations[index];
    let stride = splats.sh_stride();
    let sh = &splats.sh[index * stride..(index + 1) * stride];
    let finite = |values: &[f32]| values.iter().all(|v| v.is_finite());
    let all_finite = finite(&splats.positions[index])
        && finite(scales)
        && finite(&rotation)
        && splats.opacity_logits[index].is_finite()
        && finite(sh);
    let rotates = quaternion_length(rotation) >= MIN_QUATERNION;
    if !all_finite {
        Some(Fault::NonFinite)
    } else if !rotates {
        Some(Fault::Rotation)
    } else if !scales.iter().all(|s| s.abs() <= MAX_LOG_SCALE) {
        Some(Fault::Scale)
    } else if !sh.iter().all(|v| v.abs() <= MAX_COEFFICIENT) {
        Some(Fault::Colour)
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::sample_splats;
    use super::super::{Prior, PriorError, RenderOptions};
    use super::*;

    #[test]
    fn drops_and_counts_each_kind() {
        let mut splats = sample_splats(8, 1);
        let valid = splats.clone();
        splats.opacity_logits[1] = f32::NAN;
        splats.sh[12 * 4 + 11] = f32::NAN;
        splats.rotations[2] = [1e-7, 0.0, 0.0, -1e-7];
        splats.log_scales[6] = [0.0, 40.5, 0.0];
        splats.sh[12 * 7] = -1.1e6;
        let dropped = drop_invalid(&mut splats);
        assert_eq!(
            dropped,
            [
                Dropped { fault: Fault::NonFinite, count: 2, first: 1 },
                Dropped { fault: Fault::Rotation, count: 1, first: 2 },
                Dropped { fault: Fault::Scale, count: 1, first: 6 },
                Dropped { fault: Fault::Colour, count: 1, first: 7 },
            ]
        );
        let kept = [0, 3, 5];
        assert_eq!(splats.positions, kept.map(|i| valid.positions[i]));
        assert_eq!(splats.rotations, kept.map(|i| valid.rotations[i]));
        assert_eq!(splats.sh[12..24], valid.sh[36..48]);
        assert_eq!(splats.check_shape().ok(), Some(()));
    }

    #[test]
    fn infinite_logits_are_limits_not_faults() {
        let mut splats = sample_splats(3, 0);
        splats.opacity_logits = vec![f32::INFINITY, 0.5, f32::NEG_INFINITY];
        let prior = Prior::from_splats(splats, RenderOptions::INRIA).unwrap();
        assert_eq!(prior.splats().opacity_logits, [INFINITE_LOGIT, 0.5, -INFINITE_LOGIT]);
        assert_eq!((prior.report().kept, prior.report().clamped_logits), (3, 2));
        assert_eq!(1.0 / (1.0 + (-INFINITE_LOGIT).exp()), 1.0);
    }

    #[test]
    fn refuses_a_prior_of_invalid_splats_only() {
        let mut splats = sample_splats(2, 0);
        splats.positions[0][1] = f32::NAN;
        splats.rotations[1] = [0.0; 4];
        let refused = Prior::from_splats(splats, RenderOptions::INRIA);
        let Err(PriorError::AllDropped { read: 2, fault: Fault::NonFinite }) = refused else {
            panic!("{refused:?}");
        };
    }

    #[test]
    fn the_largest_variance_is_a_normal_number() {
        for s in [MAX_LOG_SCALE, -MAX_LOG_SCALE] {
            assert!((2.0 * s).exp().is_normal());
        }
    }
}
