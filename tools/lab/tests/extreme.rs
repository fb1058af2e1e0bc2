//! Random extreme priors, poses and cameras: always finite numbers, typed errors, the same picture
//! on both sides, and no message from the validation layer. `nvsprior-lab stability --group random`
//! runs thousands of them.

#[path = "../../../tests/common/mod.rs"]
mod common;

use std::sync::mpsc::channel;
use std::time::Duration;

use nvsprior_lab::stability::extremes::{Checked, check};

/// If a scene takes longer, it counts as hanging.
const DEADLINE: Duration = Duration::from_secs(60);

/// Checks the scenes of seeds, in order; returns how many were drawn.
fn check_all(seeds: Vec<u64>) -> usize {
    let engine = common::engine();
    let (send, outcomes) = channel();
    let (count, own) = (seeds.len(), engine.clone());
    let worker = seeds.clone();
    std::thread::spawn(move || {
        for seed in worker {
            if send.send(check(&own, seed)).is_err() {
                return;
            }
        }
    });
    let mut drawn = 0;
    for seed in &seeds[..count] {
        let outcome = outcomes.recv_timeout(DEADLINE);
        match outcome.unwrap_or_else(|e| panic!("seed {seed} hangs or panics: {e}")) {
            Ok(outcome) => drawn += usize::from(outcome == Checked::Drawn),
            Err(fault) => panic!("seed {seed}: {fault}"),
        }
    }
    common::assert_silent(&engine);
    drawn
}

#[test]
fn random_extremes() {
    let drawn = check_all((0..300).collect());
    assert!(drawn > 250, "{drawn} of 300 could be drawn");
}

/// Seeds that once failed, a line each; what follows the number says how.
#[test]
fn what_once_failed() {
    let lines = include_str!("extreme_seeds.txt").lines();
    let seeds = lines.filter(|line| !line.starts_with('#') && !line.is_empty()).map(|line| {
        let number = line.split_whitespace().next().and_then(|word| word.parse().ok());
        number.unwrap_or_else(|| panic!("no seed: {line}"))
    });
    let seeds: Vec<u64> = seeds.collect();
    assert!(!seeds.is_empty());
    check_all(seeds);
}
