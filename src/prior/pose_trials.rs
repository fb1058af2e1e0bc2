//! What a prior is worth for finding poses: pictures that it was not trained on, found by it.

/// A picture of the mapping run that was held out, and found by a prior that had not seen it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseTrial {
    /// From the mapping run's pose to the one found, along and about the camera's axes: the prior's unit, radians.
    pub error: [f32; 6],
    /// The standard deviations that an encoder stated, without any trials; infinite along open axes.
    pub deviation: [f32; 6],
}

/// Trials of a prior; none if they were not made.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PoseTrials(Vec<PoseTrial>);

/// Shares of the trials that must be off by at most so many stated deviations, along and about each axis.
const PROMISES: [(f64, f64); 2] = [(0.90, 2.0), (0.99, 4.0)];

impl PoseTrials {
    /// Most trials that a prior holds.
    pub const MAX: usize = 4096;
    /// With more doubt than this, the mapping run does not determine where cameras are: no position is known by such a
    /// prior, whatever the picture tells.
    pub const MAX_DOUBT: f64 = 5.0;

    /// `None`: too many, or a number is not what it stands for.
    pub fn new(trials: Vec<PoseTrial>) -> Option<PoseTrials> {
        let valid = |trial: &PoseTrial| {
            trial.error.iter().all(|v| v.is_finite()) && trial.deviation.iter().all(|v| *v > 0.0)
        };
        (trials.len() <= PoseTrials::MAX && trials.iter().all(valid)).then_some(PoseTrials(trials))
    }

    /// The trials, in the order in which they were made.
    pub fn trials(&self) -> &[PoseTrial] {
        &self.0
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// How many times further off poses are than an encoder states by itself: the least factor, at least 1, that makes
    /// its promises true for these trials. 1 without trials.
    pub fn doubt(&self) -> f64 {
        (0..6).map(|axis| self.doubt_of(axis)).fold(1.0, f64::max)
    }

    fn doubt_of(&self, axis: usize) -> f64 {
        let ratio = |trial: &PoseTrial| f64::from(trial.error[axis].abs() / trial.deviation[axis]);
        let mut ratios: Vec<f64> = self.0.iter().map(ratio).collect();
        ratios.sort_unstable_by(f64::total_cmp);
        let needed = |(share, most): (f64, f64)| {
            let within = (share * ratios.len() as f64).ceil() as usize;
            ratios.get(within.saturating_sub(1)).map_or(0.0, |ratio| ratio / most)
        };
        PROMISES.into_iter().map(needed).fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trial(error: f32) -> PoseTrial {
        let mut all = [0.0; 6];
        all[4] = error;
        PoseTrial { error: all, deviation: [0.1; 6] }
    }

    #[test]
    fn the_promises_hold_with_the_doubt() {
        assert_eq!(PoseTrials::default().doubt(), 1.0);
        let doubt = |errors: &[f32]| {
            PoseTrials::new(errors.iter().map(|e| trial(*e)).collect()).unwrap().doubt()
        };
        assert_eq!(doubt(&[0.05, -0.1, 0.15, 0.2]), 1.0);
        assert!((doubt(&[-0.6; 5]) - 3.0).abs() < 1e-6);
        // One of ten is far off: that is all that the second promise counts.
        let mut errors = [0.1; 10];
        errors[3] = -2.0;
        assert!((doubt(&errors) - 5.0).abs() < 1e-6);
        let mut open = trial(9.0);
        open.deviation = [f32::INFINITY; 6];
        assert_eq!(PoseTrials::new(vec![open; 3]).unwrap().doubt(), 1.0);
    }

    #[test]
    fn what_is_no_trial_is_refused() {
        let wrong = |change: &dyn Fn(&mut PoseTrial)| {
            let mut trial = trial(0.1);
            change(&mut trial);
            assert_eq!(PoseTrials::new(vec![trial]), None);
        };
        wrong(&|trial| trial.error[0] = f32::NAN);
        wrong(&|trial| trial.error[5] = f32::INFINITY);
        wrong(&|trial| trial.deviation[2] = 0.0);
        wrong(&|trial| trial.deviation[2] = f32::NAN);
        assert_eq!(PoseTrials::new(vec![trial(0.0); PoseTrials::MAX + 1]), None);
    }
}
