//! The part of the pictures that were held out and found.

use super::super::PriorError;
use super::super::pose_trials::{PoseTrial, PoseTrials};
use super::words::{Words, refusal};

const FORMAT: &str = "pose trials";

pub fn to_bytes(trials: &PoseTrials) -> Vec<u8> {
    let numbers = |trial: &PoseTrial| {
        let PoseTrial { error, deviation } = *trial;
        error.into_iter().chain(deviation)
    };
    trials.trials().iter().flat_map(numbers).flat_map(f32::to_le_bytes).collect()
}

pub fn read(content: &[u8], at: usize) -> Result<PoseTrials, PriorError> {
    let mut words = Words::new(content, at);
    let mut trials = Vec::new();
    let length = size_of::<PoseTrial>();
    for _ in 0..content.len().div_ceil(length).min(PoseTrials::MAX + 1) {
        trials.push(PoseTrial { error: words.floats()?, deviation: words.floats()? });
    }
    words.end(FORMAT)?;
    let wrong = || refusal(FORMAT, at, "too many, or a number is not what it stands for");
    PoseTrials::new(trials).ok_or_else(wrong)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trials_come_back() {
        let trial = |error| PoseTrial {
            error: [error; 6],
            deviation: [0.1, 0.2, 0.3, 0.01, f32::INFINITY, 0.03],
        };
        let trials = PoseTrials::new(vec![trial(0.1), trial(-0.2)]).unwrap();
        let bytes = to_bytes(&trials);
        assert_eq!(read(&bytes, 0).unwrap(), trials);
        for len in (0..bytes.len()).filter(|len| len % 48 != 0) {
            assert!(read(&bytes[..len], 0).is_err(), "{len} bytes");
        }
        let broken: Vec<u8> = [f32::NAN; 12].iter().flat_map(|v| v.to_le_bytes()).collect();
        assert!(read(&broken, 0).is_err());
    }
}
