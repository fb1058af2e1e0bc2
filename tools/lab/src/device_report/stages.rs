//! The device's time by stage, beside the ceilings and the model.

use super::schema::{Best, StageRow};
use crate::bench::context::Context;
use crate::bench::stages::{
    FLOW, PICTURE, Part, Runs, SEARCH, Stages, measure_jobs, search_nearby,
};
use crate::cost::{Cost, Machine, Sharing, Work};

/// Stages of every job, and those that only one job has. They are listed if the device cannot time them.
const LISTS: [&str; 6] =
    ["project", "radix_count", "radix_scatter", "bin_count", "bin_scan", "bin_emit"];
const OWN: [(&str, &[&str]); 3] = [
    (PICTURE.0, &["splat", "quantize_rgb8"]),
    (FLOW.0, &["splat_flow", "reduce"]),
    (SEARCH, &["pyramid", "splat_flow", "solve", "splat", "quantize_rgb8"]),
];

/// Measures the stages of a picture, an evaluation and a search, and predicts them.
pub fn measure(
    context: &Context,
    best: &Best,
    machine: Option<&Machine>,
    runs: Runs,
) -> anyhow::Result<Vec<StageRow>> {
    let stages = measure_jobs(context, best.rates, &[PICTURE, FLOW], search_nearby, runs)?;
    let sharing = Sharing::of(&context.engine, &context.prior);
    Ok(rows(&stages, &sharing, machine))
}

fn rows(stages: &Stages, sharing: &Sharing, machine: Option<&Machine>) -> Vec<StageRow> {
    let row = |job: &str, name: &str, ms: Option<f64>| {
        let (mut work, mut seconds) = (Work::default(), 0.0);
        for Part { counts, passes, times } in stages.parts(job, name) {
            let part = Cost { counts, sharing, passes }.of(name);
            work += part * times;
            seconds += machine.map_or(0.0, |machine| machine.seconds(&part) * times);
        }
        let ceilings = &stages.ceilings;
        let ceiling = (work.bytes / ceilings.bytes).max(work.flops / ceilings.flops);
        let is_counted = machine.is_some() && work != Work::default();
        StageRow {
            job: job.into(),
            name: name.into(),
            ms,
            bytes: work.bytes,
            flops: work.flops,
            ceiling_ms: (ceiling > 0.0).then_some(ceiling * 1e3),
            predicted_ms: is_counted.then_some(seconds * 1e3),
        }
    };
    if stages.stages.is_empty() {
        let names = OWN
            .iter()
            .flat_map(|(job, own)| LISTS.iter().chain(own.iter()).map(move |name| (*job, *name)));
        return names.map(|(job, name)| row(job, name, None)).collect();
    }
    stages.stages.iter().map(|stage| row(stage.job, stage.name, Some(stage.ms))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ceilings::Ceilings;
    use crate::cost::Counts;

    fn stages() -> Stages {
        let counts = Counts {
            splats: 40_000.0,
            visible: 38_000.0,
            coefficients: 16.0,
            planes: 24.0,
            pairs: 180_000.0,
            rows: 77_000.0,
            blended: [12e6, 11e6],
            tiles: 920.0,
            tiles_x: 40.0,
            pixels: 57_600.0,
            frame_pixels: 57_600.0,
            digits: 1024.0,
        };
        Stages::unmeasured(Ceilings { flops: 1e11, bytes: 1e10 }, counts, 2.0)
    }

    fn rows_of(machine: Option<&Machine>) -> Vec<StageRow> {
        rows(&stages(), &Sharing::GPU, machine)
    }

    #[test]
    fn without_timestamps_stages_are_listed_with_what_is_known() {
        let machine = Machine { flops: 1e11, bytes: 1e10, dispatch: 1e-5 };
        let rows = rows_of(Some(&machine));
        let find =
            |job: &str, name: &str| rows.iter().find(|r| r.job == job && r.name == name).unwrap();
        let splat = find(PICTURE.0, "splat");
        assert_eq!(splat.ms, None);
        // 12 million pairs with 24 operations each, and 28 for four.
        let ceiling = 12e6 * (24.0 + 7.0) / 1e11 * 1e3;
        assert!((splat.ceiling_ms.unwrap() / ceiling - 1.0).abs() < 1e-9);
        assert!((splat.predicted_ms.unwrap() - ceiling - 0.01).abs() < 1e-9);
        // Two evaluations.
        let [one, two] = [FLOW.0, SEARCH].map(|job| find(job, "splat_flow").flops);
        assert!((two / one - 2.0).abs() < 1e-9);
    }

    #[test]
    fn without_a_model_there_is_no_prediction() {
        assert!(rows_of(None).iter().all(|row| row.predicted_ms.is_none()));
    }
}
