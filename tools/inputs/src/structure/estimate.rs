//! How long the search for poses takes, before it begins.

use std::thread::available_parallelism;

use super::pictures::Listed;
use super::{Step, StructureOptions};

// Seconds of one core, measured on x86-64 cores of 2026; see docs/mapping.md. How fast this machine is shows in the
// first step, and corrects the others.
/// To find the features of a million pixels.
const FEATURES: f64 = 1.3;
/// To compare two pictures.
const PAIR: f64 = 0.11;
/// To find the pose of a picture with all the others, on one core.
const POSE: f64 = 0.65;

/// A step so short says little of how fast the machine is, seconds.
const DOUBT: f64 = 30.0;

/// Seconds that each step takes.
#[derive(Clone, Copy)]
pub struct Estimate {
    pictures: usize,
    pairs: usize,
    features: f64,
    matches: f64,
    poses: f64,
}

impl Estimate {
    pub fn new(listed: &Listed, options: &StructureOptions, pairs: &[(usize, usize)]) -> Estimate {
        let cores = available_parallelism().map_or(1.0, |cores| cores.get() as f64);
        let pictures = listed.names.len();
        let (width, height) = (f64::from(listed.widest.0), f64::from(listed.widest.1));
        let reduced = (f64::from(options.size) / width.max(height).max(1.0)).min(1.0);
        let pixels = 1e-6 * width * height * reduced.powi(2);
        Estimate {
            pictures,
            pairs: pairs.len(),
            features: FEATURES * pixels * pictures as f64 / cores,
            matches: PAIR * pairs.len() as f64 / cores,
            poses: POSE * pictures as f64,
        }
    }

    /// Corrects what is left by the time that a step took.
    pub fn took(&mut self, step: Step, seconds: f64) {
        let expected = match step {
            Step::Features => self.features,
            Step::Matches => self.matches,
            Step::Check | Step::Mapper => return,
        };
        let slower = (seconds + DOUBT) / (expected + DOUBT);
        self.matches *= slower;
        self.poses *= slower;
    }

    /// What is left from a step on, in words.
    pub fn text(&self, from: Step) -> String {
        let Estimate { pictures, pairs, features, matches, poses } = self;
        let features = if from == Step::Features { *features } else { 0.0 };
        let left = minutes(features + matches + poses);
        let parts = [("features", features), ("matches", *matches), ("poses", *poses)];
        let parts = parts.iter().filter(|(_, seconds)| *seconds > 0.0);
        let parts: Vec<_> =
            parts.map(|(name, seconds)| format!("{name} {}", minutes(*seconds))).collect();
        format!("{pictures} pictures, {pairs} pairs: about {left} left ({})", parts.join(", "))
    }
}

fn minutes(seconds: f64) -> String {
    match seconds {
        seconds if seconds < 90.0 => format!("{:.0} s", seconds.ceil()),
        seconds if seconds < 5_400.0 => format!("{:.0} min", seconds / 60.0),
        seconds => format!("{:.1} h", seconds / 3_600.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_is_said_and_corrected() {
        let mut estimate =
            Estimate { pictures: 500, pairs: 6_000, features: 600.0, matches: 330.0, poses: 325.0 };
        assert_eq!(
            estimate.text(Step::Features),
            "500 pictures, 6000 pairs: about 21 min left (features 10 min, matches 6 min, poses 5 min)"
        );
        let mut short = Estimate { features: 3.0, ..estimate };
        short.took(Step::Features, 36.0);
        assert_eq!(
            short.text(Step::Matches),
            "500 pictures, 6000 pairs: about 22 min left (matches 11 min, poses 11 min)"
        );
        estimate.took(Step::Features, 6_270.0);
        assert_eq!(
            estimate.text(Step::Matches),
            "500 pictures, 6000 pairs: about 1.8 h left (matches 55 min, poses 54 min)"
        );
    }
}
