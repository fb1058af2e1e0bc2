//! What is known of a frame from outside: a pose from sensors or an estimator, and when it was taken.

use glam::DVec3;

use crate::{Error, Pose};

/// Covariance of a left step `τ = (ρ, θ)`, row by row: ρ in the prior's unit, θ in radians.
pub type Covariance = [[f64; 6]; 6];

/// How far a covariance, as correlations, may be from symmetric and from positive semidefinite.
/// Estimators that work in f32 round by less.
const ROUNDING: f64 = 1e-6;
/// How far the length of a unit quaternion may be from 1.
const UNIT: f64 = 1e-4;

/// A pose from sensors or an estimator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hint {
    /// The pose.
    pub pose: Pose,
    /// How sure it is: the camera stands at `Exp(τ) ∘ pose`, and `τ` has mean 0 and this covariance. An axis of which
    /// nothing is known has an infinite variance, and 0 beside it. `None`: not stated.
    pub covariance: Option<Covariance>,
    /// Seconds from when the pose was taken to when the frame was.
    pub age: f64,
}

impl Hint {
    /// A pose as old as the frame, its covariance not stated.
    pub fn of(pose: Pose) -> Hint {
        Hint { pose, covariance: None, age: 0.0 }
    }

    /// A pose as old as the frame. `None` unless the covariance is symmetric and positive semidefinite, and finite
    /// beside infinite variances.
    pub fn with_covariance(pose: Pose, covariance: &Covariance) -> Option<Hint> {
        is_covariance(covariance).then(|| Hint { covariance: Some(*covariance), ..Hint::of(pose) })
    }

    /// A pose as old as the frame. `deviation`: standard deviations of the components of `τ`, which are independent of
    /// each other, and infinite if nothing is known. `None` if one is negative or no number.
    pub fn with_deviation(pose: Pose, deviation: &[f64; 6]) -> Option<Hint> {
        let square = |i: usize, j: usize| if i == j { deviation[i] * deviation[i] } else { 0.0 };
        let covariance = std::array::from_fn(|i| std::array::from_fn(|j| square(i, j)));
        let negative = deviation.iter().any(|d| *d < 0.0);
        Hint::with_covariance(pose, &covariance).filter(|_| !negative)
    }

    /// Standard deviations of `τ`; `None`: not stated.
    pub fn deviation(&self) -> Option<[f64; 6]> {
        self.covariance.map(|rows| std::array::from_fn(|i| rows[i][i].sqrt()))
    }

    fn check(&self, frame: u32) -> Result<(), Error> {
        let unit = (self.pose.rotation.length() - 1.0).abs() <= UNIT;
        if !(self.pose.is_finite() && unit) {
            return Err(Error::HintPose { frame });
        }
        if !self.covariance.as_ref().is_none_or(is_covariance) {
            return Err(Error::HintCovariance { frame });
        }
        let age = self.age;
        let valid = age.is_finite() && age >= 0.0;
        if valid { Ok(()) } else { Err(Error::HintAge { frame, age }) }
    }
}

/// What is known of a frame besides its picture. By default nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameInfo {
    /// The camera's rough pose.
    pub hint: Option<Hint>,
    /// When the frame was taken, seconds on a clock of the caller's. Some or all frames may leave it out. A later frame
    /// must not have an earlier time.
    pub time: Option<f64>,
}

impl FrameInfo {
    /// Whether it can be used. `frame`: the frame's number; `before`: the last time that an earlier frame
    /// stated.
    ///
    /// # Errors
    /// [`Error::HintPose`], [`Error::HintCovariance`], [`Error::HintAge`], [`Error::FrameTime`] and
    /// [`Error::FrameTimeBack`].
    #[doc(hidden)]
    pub fn check(&self, frame: u32, before: Option<f64>) -> Result<(), Error> {
        if let Some(hint) = &self.hint {
            hint.check(frame)?;
        }
        match (self.time, before) {
            (Some(time), _) if !time.is_finite() => Err(Error::FrameTime { frame, time }),
            (Some(time), Some(before)) if time < before => {
                Err(Error::FrameTimeBack { frame, time, before })
            }
            _ => Ok(()),
        }
    }
}

impl FrameInfo {
    /// As of a scene whose coordinates count from `origin`.
    pub(crate) fn relative_to(&self, origin: DVec3) -> FrameInfo {
        let moved = |hint: Hint| Hint { pose: hint.pose.relative_to(origin), ..hint };
        FrameInfo { hint: self.hint.map(moved), ..*self }
    }
}

impl From<Hint> for FrameInfo {
    fn from(hint: Hint) -> FrameInfo {
        FrameInfo { hint: Some(hint), time: None }
    }
}

impl From<Pose> for FrameInfo {
    fn from(pose: Pose) -> FrameInfo {
        Hint::of(pose).into()
    }
}

// None from `Option<Hint>`: with two of this kind, `encode(frame, None)` would be ambiguous.
impl From<Option<Pose>> for FrameInfo {
    fn from(pose: Option<Pose>) -> FrameInfo {
        FrameInfo { hint: pose.map(Hint::of), time: None }
    }
}

/// Whether a matrix is symmetric and positive semidefinite, within rounding, and finite but for variances on the
/// diagonal with 0 beside them.
fn is_covariance(rows: &Covariance) -> bool {
    let mut finite = *rows;
    for i in (0..6).filter(|i| rows[*i][*i] == f64::INFINITY) {
        if (0..6).any(|j| i != j && (rows[i][j] != 0.0 || rows[j][i] != 0.0)) {
            return false;
        }
        finite[i][i] = 0.0;
    }
    is_finite_covariance(&finite)
}

fn is_finite_covariance(rows: &Covariance) -> bool {
    if !rows.as_flattened().iter().all(|v| v.is_finite()) || (0..6).any(|i| rows[i][i] < 0.0) {
        return false;
    }
    // As correlations, since lengths and angles have different units.
    let mut scaled = [[0.0; 6]; 6];
    for (i, row) in rows.iter().enumerate() {
        for (j, value) in row.iter().enumerate() {
            let scale = rows[i][i].sqrt() * rows[j][j].sqrt();
            if scale == 0.0 && *value != 0.0 {
                return false;
            }
            scaled[i][j] = if scale == 0.0 { 0.0 } else { value / scale };
        }
    }
    let symmetric = |(i, j): (usize, usize)| (scaled[i][j] - scaled[j][i]).abs() <= ROUNDING;
    let mut pairs = (0..6).flat_map(|i| (0..i).map(move |j| (i, j)));
    pairs.all(symmetric) && is_positive(&scaled)
}

/// Whether no eigenvalue of a symmetric matrix is below `-ROUNDING`. Adds `ROUNDING` to its diagonal and tries
/// Cholesky's factorisation (Golub & Van Loan, Matrix Computations, 4.2).
fn is_positive(matrix: &[[f64; 6]; 6]) -> bool {
    let mut factor = [[0.0; 6]; 6];
    for i in 0..6 {
        for j in 0..=i {
            let known: f64 = (0..j).map(|k| factor[i][k] * factor[j][k]).sum();
            let left = matrix[i][j] - known;
            if i > j {
                factor[i][j] = left / factor[j][j];
                continue;
            }
            let pivot = left + ROUNDING;
            if !(pivot > 0.0) {
                return false;
            }
            factor[i][i] = pivot.sqrt();
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const DEVIATION: [f64; 6] = [0.1, 0.2, 0.05, 0.01, 0.02, 0.0];

    fn covariance() -> Covariance {
        Hint::with_deviation(Pose::IDENTITY, &DEVIATION).unwrap().covariance.unwrap()
    }

    fn is_sound(covariance: &Covariance) -> bool {
        Hint::with_covariance(Pose::IDENTITY, covariance).is_some()
    }

    #[test]
    fn deviations_come_back() {
        let hint = Hint::with_deviation(Pose::IDENTITY, &DEVIATION).unwrap();
        let found = hint.deviation().unwrap();
        assert!(DEVIATION.iter().zip(found).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
        assert_eq!(Hint::of(Pose::IDENTITY).deviation(), None);
        assert!(is_sound(&[[0.0; 6]; 6]), "known exactly");
        for wrong in [-0.1, f64::NAN] {
            assert_eq!(Hint::with_deviation(Pose::IDENTITY, &[wrong; 6]), None);
        }
        let open = [0.1, f64::INFINITY, 0.05, 0.01, f64::INFINITY, 0.0];
        let found = Hint::with_deviation(Pose::IDENTITY, &open).unwrap().deviation().unwrap();
        assert_eq!([found[1], found[4]], [f64::INFINITY; 2]);
    }

    #[test]
    fn what_is_no_covariance_is_refused() {
        let with = |entries: &[(usize, usize, f64)]| {
            let mut rows = covariance();
            entries.iter().for_each(|(i, j, value)| rows[*i][*j] = *value);
            is_sound(&rows)
        };
        assert!(with(&[(0, 1, 0.019), (1, 0, 0.019)]));
        assert!(with(&[(0, 1, 0.02), (1, 0, 0.02)]), "wholly correlated");
        assert!(!with(&[(0, 1, 0.021), (1, 0, 0.021)]), "more than wholly");
        assert!(!with(&[(0, 1, 0.019)]), "not symmetric");
        assert!(!with(&[(3, 3, -1e-9)]));
        assert!(!with(&[(0, 5, 1e-9), (5, 0, 1e-9)]), "with what does not vary");
        assert!(!with(&[(2, 4, f64::NAN), (4, 2, f64::NAN)]));
        assert!(with(&[(1, 1, f64::INFINITY)]), "an axis of which nothing is known");
        assert!(!with(&[(1, 1, f64::INFINITY), (0, 1, 0.01), (1, 0, 0.01)]), "with what is known");
        assert!(!with(&[(1, 1, f64::NEG_INFINITY)]));
        assert!(!with(&[(0, 1, f64::INFINITY), (1, 0, f64::INFINITY)]));
        // Each pair may be so; the three together may not.
        let apart = [(0, 1), (1, 0), (0, 2), (2, 0), (1, 2), (2, 1)];
        let deviation = |i: usize| covariance()[i][i].sqrt();
        let entries = apart.map(|(i, j)| (i, j, -0.6 * deviation(i) * deviation(j)));
        assert!(!with(&entries));
        assert!(with(&entries.map(|(i, j, v)| (i, j, v * 0.8))));
    }

    proptest! {
        /// Sums of outer products of steps are covariances: in any units, of any rank, and rounded to f32.
        #[test]
        fn sums_of_squares_are_sound(
            steps in prop::collection::vec(prop::array::uniform6(-1.0f64..1.0), 0..8),
            units in prop::array::uniform6(1e-6f64..1e6),
        ) {
            let entry = |i: usize, j: usize| -> f64 {
                steps.iter().map(|s| s[i] * units[i] * s[j] * units[j]).sum()
            };
            let exact: Covariance = std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j)));
            prop_assert!(is_sound(&exact));
            prop_assert!(is_sound(&exact.map(|row| row.map(|v| f64::from(v as f32)))));
        }

        /// They are none once one direction's variance is below zero.
        #[test]
        fn less_than_nothing_is_not(
            deviation in prop::array::uniform6(0.1f64..10.0),
            direction in prop::array::uniform6(0.1f64..1.0),
        ) {
            // vᵀ C v < 0 of C = D (I − 1.01 n nᵀ) D, n of length 1, v = D⁻¹ n.
            let length = direction.iter().map(|v| v * v).sum::<f64>().sqrt();
            let entry = |i: usize, j: usize| {
                let n = direction[i] * direction[j] / (length * length);
                (f64::from(u8::from(i == j)) - 1.01 * n) * deviation[i] * deviation[j]
            };
            let rows: Covariance = std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j)));
            prop_assert!(!is_sound(&rows));
        }
    }

    #[test]
    fn what_cannot_be_used_is_named() {
        let check = |info: FrameInfo, before| info.check(7, before);
        let hint = Hint::of(Pose::IDENTITY);
        assert!(check(FrameInfo::default(), None).is_ok());
        assert!(check(FrameInfo::from(hint), Some(5.0)).is_ok());
        assert_eq!(FrameInfo::from(None), FrameInfo::default());
        for rotation in [glam::DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0), glam::DQuat::IDENTITY * 2.0] {
            let pose = Pose { rotation, ..Pose::IDENTITY };
            assert!(matches!(check(pose.into(), None), Err(Error::HintPose { frame: 7 })));
        }
        let pose = Pose { translation: glam::DVec3::INFINITY, ..Pose::IDENTITY };
        assert!(matches!(check(Some(pose).into(), None), Err(Error::HintPose { frame: 7 })));
        let wrong = Hint { covariance: Some([[1.0; 6]; 6].map(|row| row.map(|v| -v))), ..hint };
        assert!(matches!(check(wrong.into(), None), Err(Error::HintCovariance { frame: 7 })));
        for age in [-1e-9, f64::NAN, f64::INFINITY] {
            let found = check(Hint { age, ..hint }.into(), None);
            assert!(matches!(found, Err(Error::HintAge { frame: 7, .. })));
        }
        let at = |time| FrameInfo { hint: None, time: Some(time) };
        assert!(check(at(5.0), Some(5.0)).is_ok(), "two cameras may be triggered together");
        assert!(check(at(-1e9), None).is_ok(), "any clock will do");
        let back = check(at(4.5), Some(5.0));
        assert!(matches!(back, Err(Error::FrameTimeBack { frame: 7, time: 4.5, before: 5.0 })));
        for time in [f64::NAN, f64::NEG_INFINITY] {
            assert!(matches!(check(at(time), None), Err(Error::FrameTime { frame: 7, .. })));
        }
    }
}
