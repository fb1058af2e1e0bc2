//! Random extreme scenes, thousands of them.

use std::collections::BTreeMap;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use super::case::{Bench, Case, Group, Row};
use super::extremes::{Checked, check};
use nvsprior_inputs::args::progress;

pub const GROUP: Group = Group {
    name: "random",
    about: "Random priors of 1 to 200 splats, any of whose fields may be extreme, from random poses by \
            random cameras of 1×1 to 48×48. Each is drawn and differentiated with both Jacobians; one in \
            four is searched for, encoded and decoded; one in eight is compared with the twin.",
    cases,
};

/// If a case takes longer, it counts as hanging.
const DEADLINE: Duration = Duration::from_secs(60);
/// Faults that are reported one by one; all are counted.
const TOLD: usize = 20;

fn cases(_: &Bench) -> Vec<Case> {
    let expected = "every number finite and within its bounds, typed errors only, no hang, the twin's \
                    picture, and the encoder's at the topside";
    vec![Case::new("random scenes", expected, run)]
}

fn run(bench: &Bench) -> anyhow::Result<Vec<Row>> {
    let since = Instant::now();
    let (first, count) = (bench.first_seed, bench.random_cases);
    let (send, results) = channel();
    let engine = bench.engine.clone();
    std::thread::spawn(move || {
        for seed in first..first + count as u64 {
            if send.send((seed, check(&engine, seed))).is_err() {
                return;
            }
        }
    });
    let bar = progress(count, "random");
    let mut row = Row::default();
    let mut outcomes = BTreeMap::new();
    let mut faults = 0;
    for number in 0..count as u64 {
        match results.recv_timeout(DEADLINE) {
            Ok((_, Ok(outcome))) => *outcomes.entry(name(outcome)).or_insert(0) += 1,
            Ok((seed, Err(fault))) => {
                faults += 1;
                if faults <= TOLD {
                    row.faults.push(format!("seed {seed}: {fault}"));
                }
            }
            Err(RecvTimeoutError::Timeout) => {
                row.faults.push(format!("seed {} hangs", first + number));
                break;
            }
            Err(RecvTimeoutError::Disconnected) => {
                row.faults.push(format!("seed {} panicked", first + number));
                break;
            }
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    let counts: Vec<String> = outcomes.iter().map(|(name, n)| format!("{n} {name}")).collect();
    row.note = format!(
        "seeds {first} to {}: {}, {faults} faults",
        first + count as u64 - 1,
        counts.join(", ")
    );
    let milliseconds = since.elapsed().as_secs_f64() * 1e3;
    Ok(vec![Row { path: "all", milliseconds, ..row }])
}

fn name(outcome: Checked) -> &'static str {
    match outcome {
        Checked::Drawn => "drawn",
        Checked::Refused => "refused: no splat was valid",
    }
}
