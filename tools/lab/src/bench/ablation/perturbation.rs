//! Perturbations of starts: along or about one axis of the camera, as in the paper's ablations.

use nvsprior::geometry::Twist;

use super::super::perturbed::even;

/// Rotations are moved off by up to this, degrees (paper).
pub const DEGREES: f64 = 40.0;

/// Bins of equal width that the size of perturbations is summed up in.
pub const BINS: usize = 4;

/// Which part of the pose is moved off.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Rotation,
    Translation,
}

impl Kind {
    pub const ALL: [Kind; 2] = [Kind::Rotation, Kind::Translation];

    pub fn name(self) -> &'static str {
        match self {
            Kind::Rotation => "rotation",
            Kind::Translation => "translation",
        }
    }

    pub fn unit(self) -> &'static str {
        match self {
            Kind::Rotation => "degrees",
            Kind::Translation => "units",
        }
    }

    fn seed(self) -> u64 {
        match self {
            Kind::Rotation => 11,
            Kind::Translation => 12,
        }
    }
}

/// Largest perturbations, in both directions.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub struct Limits {
    /// The prior's unit.
    pub units: f64,
    pub degrees: f64,
}

impl Limits {
    pub fn of(&self, kind: Kind) -> f64 {
        match kind {
            Kind::Rotation => self.degrees,
            Kind::Translation => self.units,
        }
    }

    pub fn bin(&self, perturbation: &Perturbation) -> usize {
        let share = perturbation.value.abs() / self.of(perturbation.kind);
        ((share * BINS as f64) as usize).min(BINS - 1)
    }

    /// Where a bin begins and ends.
    pub fn bounds(&self, kind: Kind, bin: usize) -> [f64; 2] {
        [bin, bin + 1].map(|edge| self.of(kind) * edge as f64 / BINS as f64)
    }
}

/// A start's distance from the best known pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Perturbation {
    pub kind: Kind,
    /// 0, 1, 2: the camera's x, y, z.
    pub axis: usize,
    /// The prior's unit, or degrees.
    pub value: f64,
}

impl Perturbation {
    /// The perturbation of this number: a random axis and a uniform random value, the same in every run.
    pub fn of(kind: Kind, limits: &Limits, number: usize) -> Perturbation {
        let mut drawn = even(kind.seed()).skip(2 * number);
        let mut next = || drawn.next().unwrap_or_default();
        let axis = ((next() + 1.0) * 1.5) as usize;
        Perturbation { kind, axis: axis.min(2), value: limits.of(kind) * next() }
    }

    /// The step that it is, to apply to the best known pose.
    pub fn step(&self) -> Twist {
        let mut step = [0.0; 6];
        match self.kind {
            Kind::Translation => step[self.axis] = self.value,
            Kind::Rotation => step[3 + self.axis] = self.value.to_radians(),
        }
        step
    }

    pub fn axis_name(&self) -> &'static str {
        ["x", "y", "z"][self.axis]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: Limits = Limits { units: 1.58, degrees: 40.0 };

    #[test]
    fn all_axes_signs_and_bins_come_up_and_one_axis_at_a_time() {
        for kind in Kind::ALL {
            let drawn: Vec<_> = (0..300).map(|n| Perturbation::of(kind, &LIMITS, n)).collect();
            for axis in 0..3 {
                let count = drawn.iter().filter(|p| p.axis == axis).count();
                assert!((70..130).contains(&count), "{kind:?} {axis}: {count}");
            }
            for bin in 0..BINS {
                let of_bin = || drawn.iter().filter(|p| LIMITS.bin(p) == bin);
                assert!((50..100).contains(&of_bin().count()));
                let [low, high] = LIMITS.bounds(kind, bin);
                assert!(of_bin().all(|p| (low..=high).contains(&p.value.abs())));
            }
            assert!(drawn.iter().any(|p| p.value < 0.0) && drawn.iter().any(|p| p.value > 0.0));
            assert!(drawn.iter().all(|p| p.step().iter().filter(|v| **v != 0.0).count() == 1));
        }
    }
}
