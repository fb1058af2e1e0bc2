//! The measurements as text.

use super::configurations::recommended;
use super::context::{Context, host_bytes};
use super::report::{Figures, Report, errors};
use super::statistics::Spread;

const MIB: f64 = 1024.0 * 1024.0;

/// Prints all of it, compactly.
pub fn print(context: &Context, report: &Report) {
    let forward = Spread::of(context.forward.times.iter().copied());
    println!("{}", context.engine.device());
    println!("{} frames, {} splats", context.shots.len(), context.prior.splats().len());
    let best = Spread::of(context.best.iter().map(|best| best.psnr));
    println!("best known poses: {:.2} dB in the median", best.median);
    println!("forward render: {:.2} ms, 95 % {:.2} ms", forward.median, forward.p95);
    starts(context, report);
    let steady = report.steady();
    let code = Spread::of(steady.iter().map(|s| s.stats.code_milliseconds));
    let bytes = Spread::of(steady.iter().map(|s| s.stats.bytes as f64));
    println!("coding: {:.2} ms, {:.0} bytes per packet at quality 10", code.median, bytes.median);
    let (latency, pipelined) = (report.rates.latency, report.rates.pipelined);
    println!("frames per second: {latency:.2} one by one, {pipelined:.2} pipelined");
    for run in &report.runs[1..] {
        let [mse, gauss_newton] = errors(run, steady);
        let name = run.optimizer.name();
        println!(
            "final error of {name}: {mse:.6}, of gauss-newton on the same frames: {gauss_newton:.6}"
        );
    }
    let memory = context.device_memory;
    let [used, reserved] = [memory.used, memory.reserved].map(|bytes| bytes as f64 / MIB);
    print!("memory: {used:.1} MiB in use on the device, {reserved:.1} taken from the driver");
    match (report.host_bytes_steady, host_bytes()) {
        (Some(steady), Some(all)) => {
            let (steady, all) = (steady as f64 / MIB, all as f64 / MIB);
            println!(", {steady:.1} MiB on the host at the end of the steady run, {all:.1} in all");
        }
        _ => println!(),
    }
    stages(report);
    configurations(report);
    scaling(report);
}

fn starts(context: &Context, report: &Report) {
    println!(
        "\n{:16} {:>9} {:>9} {:>8} {:>6} {:>9} {:>9} {:>9}  renders by level",
        "run", "frame ms", "95 %", "forward", "95 %", "failures", "dB short", "95 %"
    );
    let steady = [("steady", report.steady())];
    let runs = report.runs[1..].iter().map(|run| (run.optimizer.name(), &run.samples[..]));
    for (name, samples) in steady.into_iter().chain(report.trials()).chain(runs) {
        let f = Figures::of(context, samples);
        let renders: Vec<String> = f.renders.iter().map(|r| format!("{r:.1}")).collect();
        println!(
            "{name:16} {:9.2} {:9.2} {:8.2} {:6.2} {:>9} {:9.4} {:9.4}  {}",
            f.frame_ms.median,
            f.frame_ms.p95,
            f.in_forward_renders.median,
            f.in_forward_renders.p95,
            format!("{}/{}", f.failures, f.trials),
            f.db_short.median,
            f.db_short.p95,
            renders.join(" "),
        );
    }
}

fn stages(report: &Report) {
    let ceilings = &report.stages.ceilings;
    let (flops, bytes) = (ceilings.flops * 1e-9, ceilings.bytes * 1e-9);
    println!("\nceilings: {flops:.1} GFLOP/s of multiply-adds, {bytes:.2} GB/s of copying");
    let counts = &report.stages.counts;
    println!(
        "a picture: {:.0} splats seen, {:.0} pairs, {:.2} M splats times pixels",
        counts.visible,
        counts.pairs,
        counts.blended[0] * 1e-6
    );
    let mut job = "";
    for stage in &report.stages.stages {
        if stage.job != job {
            job = stage.job;
            let of_job = report.stages.stages.iter().filter(|s| s.job == job);
            let total: f64 = of_job.map(|s| s.ms).sum();
            println!("{job}: {total:.2} ms on the device");
        }
        println!(
            "  {:14} {:9.3} ms {:8.2} GB/s {:4.0} % {:8.2} GFLOP/s {:4.0} %  {}",
            stage.name,
            stage.ms,
            rate(stage.work.bytes, stage.ms),
            100.0 * stage.share_of_copy,
            rate(stage.work.flops, stage.ms),
            100.0 * stage.share_of_fma,
            stage.bound(),
        );
    }
}

/// Thousand millions per second.
fn rate(amount: f64, ms: f64) -> f64 {
    if ms > 0.0 { amount / ms * 1e-6 } else { 0.0 }
}

fn configurations(report: &Report) {
    if report.configurations.is_empty() {
        return;
    }
    println!(
        "\n{:22} {:>9} {:>9} {:>9} {:>9} {:>8} {:>7}  (* Pareto set)",
        "setting", "dB short", "95 %", "frame ms", "95 %", "forward", "bytes"
    );
    for row in &report.configurations {
        println!(
            "{:22} {:9.4} {:9.4} {:9.2} {:9.2} {:8.2} {:7.0} {}",
            row.name,
            row.loss.median,
            row.loss.p95,
            row.frame_ms.median,
            row.frame_ms.p95,
            row.in_forward_renders.median,
            row.bytes.median,
            if row.pareto { "*" } else { "" },
        );
    }
    match recommended(&report.configurations) {
        Some(row) => println!("recommended: {}", row.name),
        None => println!("recommended: none, all lose more than they may"),
    }
}

fn scaling(report: &Report) {
    if report.scaling.is_empty() {
        return;
    }
    println!("\n{:>9} {:>10} {:>11} {:>13}", "splats", "size", "forward ms", "evaluation ms");
    for row in &report.scaling {
        let size = format!("{}×{}", row.width, row.height);
        match &row.times {
            Ok(t) => println!(
                "{:9} {size:>10} {:11.2} {:13.2}",
                row.splats, t.forward_ms, t.evaluation_ms
            ),
            Err(error) => println!("{:9} {size:>10} {error}", row.splats),
        }
    }
}
