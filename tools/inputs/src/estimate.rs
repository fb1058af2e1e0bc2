//! How long the search for poses takes, before it begins.

use std::thread::available_parallelism;

// Seconds of one core, measured on x86-64 cores of 2026; see docs/mapping.md. How fast this machine is shows in the
// first step, and corrects the others.
/// To find the features of a million pixels.
const FEATURES: f64 = 1.3;
/// To compare two pictures.
const PAIR: f64 = 0.11;
/// To find the pose of a picture with all the others, on one core.
const POSE: f64 = 0.65;
/// Pairs of a picture with others, about, if they are frames of a video: 15 of one whose pose is found first, 5 of
/// another.
const PAIRS: usize = 8;

/// A step so short says little of how fast the machine is, seconds.
const DOUBT: f64 = 30.0;

pub fn cores() -> f64 {
    available_parallelism().map_or(1.0, |cores| cores.get() as f64)
}

/// How many times as long as expected a step took, as far as that says something of those that follow.
pub fn slower(seconds: f64, expected: f64) -> f64 {
    (seconds + DOUBT) / (expected + DOUBT)
}

/// Seconds that each step of the search for poses takes.
#[derive(Clone, Copy)]
pub struct PoseEstimate {
    pictures: usize,
    pairs: usize,
    features: f64,
    matches: f64,
    poses: f64,
}

impl PoseEstimate {
    /// Of pictures of a size, which are reduced to a longest side for matching.
    pub fn new(pictures: usize, pairs: usize, size: (u32, u32), longest: u32) -> PoseEstimate {
        let (width, height) = (f64::from(size.0), f64::from(size.1));
        let reduced = (f64::from(longest) / width.max(height).max(1.0)).min(1.0);
        let pixels = 1e-6 * width * height * reduced.powi(2);
        PoseEstimate {
            pictures,
            pairs,
            features: FEATURES * pixels * pictures as f64 / cores(),
            matches: PAIR * pairs as f64 / cores(),
            poses: POSE * pictures as f64,
        }
    }

    /// Of so many frames of a video.
    pub fn of_video(pictures: usize, size: (u32, u32), longest: u32) -> PoseEstimate {
        let pairs = (pictures * PAIRS).min(pictures * pictures.saturating_sub(1) / 2);
        PoseEstimate::new(pictures, pairs, size, longest)
    }

    /// Corrects what is left by the time that the features took.
    pub fn features_took(&mut self, seconds: f64) {
        let slower = slower(seconds, self.features);
        self.features = 0.0;
        self.matches *= slower;
        self.poses *= slower;
    }

    /// All that is left.
    pub fn seconds(&self) -> f64 {
        self.features + self.matches + self.poses
    }

    /// What is left, in words.
    pub fn text(&self) -> String {
        let PoseEstimate { pictures, pairs, features, matches, poses } = self;
        let left = minutes(self.seconds());
        let parts = [("features", features), ("matches", matches), ("poses", poses)];
        let parts = parts.iter().filter(|(_, seconds)| **seconds > 0.0);
        let parts: Vec<_> =
            parts.map(|(name, seconds)| format!("{name} {}", minutes(**seconds))).collect();
        format!("{pictures} pictures, {pairs} pairs: about {left} left ({})", parts.join(", "))
    }
}

/// Seconds in words.
pub fn minutes(seconds: f64) -> String {
    match seconds {
        seconds if seconds < 90.0 => format!("{:.0} s", seconds.ceil()),
        seconds if seconds < 5_400.0 => format!("{:.0} min", seconds / 60.0),
        seconds => format!("{:.1} h", seconds / 3_600.0),
    }
}

/// From so many seconds to so many, in words.
pub fn range([least, most]: [f64; 2]) -> String {
    let [least, most] = [least, most].map(minutes);
    if least == most { least } else { format!("{least} to {most}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_is_said_and_corrected() {
        let mut estimate = PoseEstimate {
            pictures: 500,
            pairs: 6_000,
            features: 600.0,
            matches: 330.0,
            poses: 325.0,
        };
        assert_eq!(
            estimate.text(),
            "500 pictures, 6000 pairs: about 21 min left (features 10 min, matches 6 min, poses 5 min)"
        );
        let mut short = PoseEstimate { features: 3.0, ..estimate };
        short.features_took(36.0);
        assert_eq!(
            short.text(),
            "500 pictures, 6000 pairs: about 22 min left (matches 11 min, poses 11 min)"
        );
        estimate.features_took(6_270.0);
        assert_eq!(
            estimate.text(),
            "500 pictures, 6000 pairs: about 1.8 h left (matches 55 min, poses 54 min)"
        );
        assert_eq!(range([50.0, 700.0]), "50 s to 12 min");
        assert_eq!(range([300.0, 301.0]), "5 min");
    }
}
