//! The measurements as tables, CSV and JSON.

use std::path::Path;

use anyhow::Context;
use nvsprior::picture::psnr_of_mse;
use nvsprior::vulkan::{DeviceInfo, StageTime};
use serde_json::{Value, json};

use super::{OptimizerRun, Stages};

/// Prints means by optimiser.
pub fn print(runs: &[OptimizerRun]) {
    println!(
        "{:14} {:>9} {:>9} {:>12} {:>14} {:>10}",
        "optimiser", "render dB", "PSNR dB", "full renders", "renders, total", "ms a frame"
    );
    for run in runs {
        let mean = |figure: fn(&nvsprior::FrameStats) -> f64| {
            let sum: f64 = run.frames.iter().map(|f| figure(&f.stats)).sum();
            sum / run.frames.len().max(1) as f64
        };
        println!(
            "{:14} {:9.3} {:9.3} {:12.2} {:14} {:10.1}",
            run.optimizer.name(),
            mean(|s| s.render_psnr),
            mean(|s| s.psnr),
            mean(|s| f64::from(s.full_renders)),
            run.frames.iter().map(|f| f.stats.full_renders).sum::<u32>(),
            mean(|s| s.milliseconds),
        );
    }
}

/// Prints the device's time by stage.
pub fn print_stages(stages: &Stages) {
    for (name, times) in kinds(stages) {
        let total: f64 = times.iter().map(|t| t.milliseconds).sum();
        println!("\n{name}: {total:.2} ms on the device");
        for StageTime { name, milliseconds } in times {
            println!("  {name:14} {milliseconds:9.3} ms {:5.1} %", 100.0 * milliseconds / total);
        }
    }
}

fn kinds(stages: &Stages) -> [(&'static str, &[StageTime]); 3] {
    [
        ("picture", &stages.picture),
        ("normal equations, flow Jacobian", &stages.flow),
        ("normal equations, exact Jacobian", &stages.exact),
    ]
}

/// Writes bench.csv (a row an evaluation) and bench.json.
pub fn write(
    folder: &Path,
    device: &DeviceInfo,
    runs: &[OptimizerRun],
    stages: &Stages,
) -> anyhow::Result<()> {
    let path = folder.join("bench.csv");
    write_csv(&path, runs).with_context(|| format!("writing {}", path.display()))?;
    let path = folder.join("bench.json");
    let stages: serde_json::Map<String, Value> =
        kinds(stages).into_iter().map(|(name, times)| (name.into(), by_stage(times))).collect();
    let report = json!({
        "device": device.to_string(),
        "optimizers": runs.iter().map(run_json).collect::<Vec<_>>(),
        "stage_milliseconds": stages,
    });
    std::fs::write(&path, serde_json::to_string_pretty(&report)? + "\n")
        .with_context(|| format!("writing {}", path.display()))
}

fn write_csv(path: &Path, runs: &[OptimizerRun]) -> Result<(), csv::Error> {
    let mut csv = csv::Writer::from_path(path)?;
    csv.write_record(["optimizer", "file", "evaluation", "level", "psnr", "milliseconds"])?;
    for run in runs {
        for frame in &run.frames {
            for (index, evaluation) in frame.trace.iter().enumerate() {
                csv.write_record([
                    run.optimizer.name(),
                    &frame.file,
                    &index.to_string(),
                    &evaluation.level.to_string(),
                    &format!("{:.4}", psnr_of_mse(evaluation.mse)),
                    &format!("{:.3}", evaluation.milliseconds),
                ])?;
            }
        }
    }
    Ok(csv.flush()?)
}

fn by_stage(times: &[StageTime]) -> Value {
    let entries = times.iter().map(|t| (t.name.to_owned(), json!(t.milliseconds)));
    Value::Object(entries.collect())
}

fn run_json(run: &OptimizerRun) -> Value {
    let frames: Vec<Value> = run
        .frames
        .iter()
        .map(|frame| {
            let evaluations: Vec<Value> = frame
                .trace
                .iter()
                .map(|e| json!([e.level, psnr_of_mse(e.mse), e.milliseconds]))
                .collect();
            json!({
                "file": frame.file,
                "render_psnr": frame.stats.render_psnr,
                "psnr": frame.stats.psnr,
                "bytes": frame.stats.bytes,
                "full_renders": frame.stats.full_renders,
                "milliseconds": frame.stats.milliseconds,
                "start": frame.stats.start.name(),
                "level_psnr_milliseconds": evaluations,
            })
        })
        .collect();
    json!({ "optimizer": run.optimizer.name(), "frames": frames })
}
