//! The measurements as text.

use super::commands::Counts;
use super::configurations::recommended;
use super::context::{Context, host_bytes};
use super::report::{Report, errors};
use super::tables;
use nvsprior_inputs::statistics::Spread;

const MIB: f64 = 1024.0 * 1024.0;

/// Prints all of it, compactly.
pub fn print(context: &Context, report: &Report) {
    let forward = Spread::of(context.forward.times.iter().copied());
    println!("{}", context.engine.device());
    println!("{} frames, {} splats", context.shots.len(), context.prior.splats().len());
    let best = Spread::of(context.best.iter().map(|best| best.psnr));
    println!("best known poses: {:.2} dB in the median", best.median);
    println!("forward render: {:.2} ms, 95 % {:.2} ms", forward.median, forward.p95);
    println!();
    tables::starts(context, report).print();
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
    for stages in report.stages.stages.chunk_by(|a, b| a.job == b.job) {
        let total: f64 = stages.iter().map(|stage| stage.ms).sum();
        println!("{}: {total:.2} ms on the device", stages[0].job);
        tables::job(stages).print();
    }
    println!("a frame of one evaluation:");
    let commands = &report.stages.commands;
    for (what, counts) in [("that do something", commands.run), ("unused", commands.unused)] {
        let Counts { dispatches, fills, copies, barriers } = counts;
        println!(
            "  {what}: {dispatches} dispatches, {fills} fills, {copies} copies, {barriers} barriers"
        );
    }
}

fn configurations(report: &Report) {
    if report.configurations.is_empty() {
        return;
    }
    println!();
    let columns = [
        "configuration",
        "db_short",
        "db_short_p95",
        "frame_ms",
        "in_forward_renders",
        "bytes_quality_10",
        "pareto",
    ];
    tables::settings(&report.configurations).only(&columns).print();
    match recommended(&report.configurations) {
        Some(row) => println!("recommended: {}", row.name),
        None => println!("recommended: none, all lose more than they may"),
    }
}
