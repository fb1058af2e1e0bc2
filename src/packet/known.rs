//! How sure the vehicle is of a pose, in three bits.

use crate::geometry::Twist;

/// Greatest standard deviation of each class: of the position along the camera's axes, in units of the prior, and of
/// the turns about them, radians.
const BOUNDS: [f64; 6] = [0.0003, 0.001, 0.003, 0.01, 0.03, 0.1];
/// Codes before those of the classes.
const CONFIRMED: u8 = 0;
const UNCERTAIN: u8 = 1;
const FIRST: u8 = 2;

/// A class of how well a pose is known. In units of the prior: see
/// [`CoordinateFrame::unit`](crate::prior::CoordinateFrame::unit).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PoseBound(u8);

/// Within how much a pose is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KnownPose {
    /// Greatest standard deviation of the position along an axis of the camera, in the prior's unit.
    pub position: f64,
    /// Greatest standard deviation of a turn about an axis of the camera, radians.
    pub rotation: f64,
}

impl PoseBound {
    /// The finest class that holds all of a pose's deviations, of ρ in the prior's own lengths and θ in radians. `None`
    /// if none does. `unit`: the length that the prior's packets count in.
    pub fn of(deviation: &Twist, unit: f64) -> Option<PoseBound> {
        let scaled =
            |(i, deviation): (usize, &f64)| if i < 3 { deviation / unit } else { *deviation };
        let holds = |bound: &f64| deviation.iter().enumerate().map(scaled).all(|d| d <= *bound);
        BOUNDS.iter().position(holds).map(|class| PoseBound(class as u8))
    }

    /// What it says, for a prior whose packets count in this length.
    pub fn of_unit(self, unit: f64) -> KnownPose {
        let bound = BOUNDS[usize::from(self.0)];
        KnownPose { position: bound * unit, rotation: bound }
    }
}

/// What a packet says of its pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Confidence(u8);

impl Confidence {
    pub fn of(uncertain: bool, known: Option<PoseBound>) -> Confidence {
        Confidence(match (uncertain, known) {
            (true, _) => UNCERTAIN,
            (false, None) => CONFIRMED,
            (false, Some(PoseBound(class))) => FIRST + class,
        })
    }

    /// `code`: below 8.
    pub fn of_code(code: u8) -> Confidence {
        Confidence(code)
    }

    pub fn code(self) -> u8 {
        self.0
    }

    pub fn is_uncertain(self) -> bool {
        self.0 == UNCERTAIN
    }

    pub fn known(self) -> Option<PoseBound> {
        self.0.checked_sub(FIRST).map(PoseBound)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_code_comes_back() {
        for code in 0..8 {
            let confidence = Confidence::of_code(code);
            let (uncertain, known) = (confidence.is_uncertain(), confidence.known());
            assert_eq!(Confidence::of(uncertain, known).code(), code);
            assert!(!(uncertain && known.is_some()));
        }
    }

    #[test]
    fn a_class_holds_every_deviation() {
        let deviation = [0.02, 0.001, 0.04, 0.002, 0.009, 0.001];
        let known =
            |deviation: &Twist| PoseBound::of(deviation, 5.0).map(|bound| bound.of_unit(5.0));
        let KnownPose { position, rotation } = known(&deviation).unwrap();
        assert_eq!((position, rotation), (0.05, 0.01));
        for (axis, wide) in [(1, 0.6), (3, 0.11), (2, f64::INFINITY), (5, f64::NAN)] {
            let mut other = deviation;
            other[axis] = wide;
            assert_eq!(known(&other), None, "{axis}");
        }
    }
}
