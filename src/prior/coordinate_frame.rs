//! The frame in which packets state camera positions.

use glam::DVec3;

/// Steps of the compact centre per unit of the prior's frame.
const STEPS_PER_UNIT: f64 = 131_072.0;

/// The place and size of a prior, by medians, so that a few stray splats do not count.
///
/// Both sides compute it from the same splats with the same comparisons, so with the same bits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CoordinateFrame {
    /// Per axis the lower median of the splats' positions.
    pub centre: [f32; 3],
    /// Largest of the three median absolute deviations from `centre`, in the prior's unit. If that
    /// is zero (half the splats share a coordinate on every axis): the largest deviation. For a
    /// prior of one point: 1. So it is always positive and finite.
    pub spread: f32,
}

impl CoordinateFrame {
    /// The unit of lengths in packets: `spread`, but at least 2⁻²³ of the distance from the origin
    /// (the resolution of f32 there). So f64 tells steps of 2⁻¹⁷ units apart everywhere.
    pub fn unit(&self) -> f64 {
        let distance = self.centre.iter().map(|v| f64::from(v.abs())).fold(0.0, f64::max);
        f64::from(self.spread).max(distance * 2_f64.powi(-23))
    }

    /// Step of a camera's centre in a compact packet, the prior's own unit of length.
    pub fn step(&self) -> f64 {
        self.unit() / STEPS_PER_UNIT
    }

    /// The distance from the centre that no position exceeds, the prior's unit. Rounding to f32 does not change that.
    pub(crate) fn radius_of<'a>(&self, positions: impl IntoIterator<Item = &'a [f32; 3]>) -> f32 {
        let centre = DVec3::from(self.centre.map(f64::from));
        let distance = |p: &[f32; 3]| DVec3::from(p.map(f64::from)).distance(centre);
        let farthest = positions.into_iter().map(distance).fold(0.0, f64::max);
        // Both roundings to f32 are far below this.
        (farthest * (1.0 + 1e-6)) as f32
    }

    /// The frame of finite `positions`, of which there is at least one.
    pub(super) fn of(positions: &[[f32; 3]]) -> CoordinateFrame {
        let axes = [0, 1, 2].map(|axis| deviations(positions, axis));
        let spread = spreads(&axes)
            .map(|s| (s as f32).min(f32::MAX))
            .into_iter()
            .find(|s| *s > 0.0)
            .unwrap_or(1.0);
        CoordinateFrame { centre: axes.map(|a| a.centre as f32), spread }
    }
}

/// What the spread is, the first that is above zero.
fn spreads(axes: &[Axis; 3]) -> [f64; 3] {
    let largest = |pick: fn(&Axis) -> f64| axes.iter().map(pick).fold(0.0, f64::max);
    [largest(|a| a.median), largest(|a| a.max), 1.0]
}

/// 32-bit numbers so many spreads from zero are further apart than the steps in which packets state cameras.
const FAR: f64 = 8_388_608.0 / STEPS_PER_UNIT;

/// The point that positions should count from; `None`: zero. It is in whole units, so no digit is lost.
pub fn origin_of<T: Copy + Into<f64>>(positions: &[[T; 3]]) -> Option<[f64; 3]> {
    positions.first()?;
    let axes = [0, 1, 2].map(|axis| deviations(positions, axis));
    let spread = spreads(&axes).into_iter().find(|s| *s > 0.0)?;
    let centre = axes.map(|a| a.centre);
    let distance = centre.into_iter().map(f64::abs).fold(0.0, f64::max);
    let is_far = distance > FAR * spread && centre.iter().all(|v| v.is_finite());
    is_far.then(|| centre.map(f64::round)).filter(|origin| origin.iter().any(|v| *v != 0.0))
}

/// One axis: the median, and the median and the largest of the deviations from it.
struct Axis {
    centre: f64,
    median: f64,
    max: f64,
}

fn deviations<T: Copy + Into<f64>>(positions: &[[T; 3]], axis: usize) -> Axis {
    let mut values: Vec<f64> = positions.iter().map(|p| p[axis].into()).collect();
    let centre = lower_median(&mut values);
    values.iter_mut().for_each(|v| *v = (*v - centre).abs());
    let max = values.iter().copied().fold(0.0, f64::max);
    Axis { centre, median: lower_median(&mut values), max }
}

/// The median; for an even count the lower of the two middle values. So it is one of the values,
/// and nothing is rounded.
fn lower_median(values: &mut [f64]) -> f64 {
    let middle = (values.len() - 1) / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strays_do_not_count() {
        let mut positions: Vec<[f32; 3]> =
            (0..101).map(|i| [i as f32, 5.0 + 0.1 * i as f32, -3.0]).collect();
        let frame = CoordinateFrame::of(&positions);
        assert_eq!(frame.centre, [50.0, 10.0, -3.0]);
        assert_eq!(frame.spread, 25.0);
        positions[3] = [1e30, -1e30, f32::MAX];
        let with_stray = CoordinateFrame::of(&positions);
        assert!((with_stray.centre[0] - 50.0).abs() <= 1.0);
        assert!((with_stray.spread - 25.0).abs() <= 1.0);
    }

    #[test]
    fn order_does_not_matter() {
        let mut positions: Vec<[f32; 3]> =
            (0..50_u32).map(|i| [(i * 37 % 50) as f32, (i * 11 % 7) as f32, 0.0]).collect();
        let frame = CoordinateFrame::of(&positions);
        positions.reverse();
        assert_eq!(CoordinateFrame::of(&positions), frame);
    }

    #[test]
    fn spread_is_positive_and_finite() {
        assert_eq!(CoordinateFrame::of(&[[1.0; 3]]).spread, 1.0);
        assert_eq!(CoordinateFrame::of(&[[1.0; 3], [1.0; 3], [1.0, 1.0, 4.0]]).spread, 3.0);
        let far = CoordinateFrame::of(&[[f32::MIN; 3], [f32::MAX; 3], [f32::MAX; 3]]);
        assert_eq!(far.spread, f32::MAX);
    }
}
