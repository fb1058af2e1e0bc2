//! The report as text, and its tables.

use super::schema::{Report, Size, StageRow};
use crate::bench::report::Figures;
use nvsprior_inputs::report::{Table, fixed, fixed_or_empty};
use nvsprior_inputs::statistics::Spread;

const MEGA: f64 = 1e6;

/// Prints all of it, compactly.
pub fn print(report: &Report) {
    println!();
    for (name, value) in facts(report) {
        println!("{name}: {value}");
    }
    for size in &report.sizes {
        println!();
        println!("{}×{}", size.width, size.height);
        stages(size).print();
        println!();
        times(size).print();
    }
}

/// What there is to say in a line each.
pub fn facts(report: &Report) -> Vec<(&'static str, String)> {
    let mut facts = Vec::new();
    if let Some(d) = &report.device {
        let (kind, form) = (&d.kind, &d.form);
        let clock = if d.timestamps { "timestamps" } else { "no timestamps" };
        facts.push(("device", d.name.clone()));
        facts.push(("driver", format!("{}, Vulkan {}", d.driver, d.vulkan)));
        facts
            .push(("kind", format!("{kind}, subgroups of {}, stages {form}, {clock}", d.subgroup)));
        facts.push(("device memory", format!("{:.0} MB", d.memory_bytes as f64 / MEGA)));
    }
    facts.push(("machine", machine(report)));
    facts.push(("verdict", verdict(report)));
    if let Some(best) = &report.ceilings {
        let (copy, flops) = (best.rates.bytes * 1e-9, best.rates.flops * 1e-9);
        let dispatch = best.dispatch_seconds * 1e6;
        let best =
            format!("{copy:.3} GB/s copied, {flops:.1} GFLOP/s, {dispatch:.1} µs a dispatch");
        facts.push(("ceilings", best));
    }
    facts.push(("prediction", model(report)));
    let b = report.bounds;
    facts.push((
        "bounds",
        format!(
            "{} scenes, {} runs of each job, {} frames, {} starts, {} s; it took {:.0} s",
            b.scenes, b.runs, b.frames, b.trials, b.seconds, report.seconds
        ),
    ));
    let missing = report.not_measured.iter().map(|m| ("not measured", m));
    let failed = report.failures.iter().map(|m| ("FAILED", m));
    facts.extend(missing.chain(failed).map(|(kind, m)| (kind, format!("{}: {}", m.what, m.why))));
    facts
}

fn machine(report: &Report) -> String {
    let host = &report.host;
    let names = [&host.board, &host.processor].into_iter().flatten().cloned();
    let threads = format!("{} threads, {}", host.threads, host.system);
    names.chain([threads]).collect::<Vec<_>>().join(", ")
}

/// Whether the device draws what every portable device draws.
pub fn verdict(report: &Report) -> String {
    match &report.verify {
        None => "NOT known whether portable".into(),
        Some(v) if v.portable => format!("portable: {} pictures, no byte differs", v.pictures),
        Some(v) => format!("NOT portable: {}", v.difference.as_deref().unwrap_or_default()),
    }
}

fn model(report: &Report) -> String {
    let model = &report.model;
    let Some(name) = &model.name else { return "none".into() };
    let [copy, flops, dispatch] = [
        (model.copy_bytes, 1e-9, "GB/s copied"),
        (model.flops, 1e-9, "GFLOP/s"),
        (model.dispatch_seconds, 1e6, "µs a dispatch"),
    ]
    .map(|(value, unit, name)| format!("{} {name}", fixed_or_empty(value.map(|v| v * unit), 1)));
    format!("{name}: {copy}, {flops}, {dispatch}")
}

/// The stages of all jobs, measured beside ceiling and prediction, with sums of what is predicted.
pub fn stages(size: &Size) -> Table {
    let mut table =
        Table::new(["job", "stage", "ms", "at the ceilings", "predicted", "measured/predicted"]);
    for rows in size.stages.chunk_by(|a, b| a.job == b.job) {
        for StageRow { job, name, ms, ceiling_ms, predicted_ms, .. } in rows {
            let own = [*ms, *ceiling_ms, *predicted_ms];
            table.push([[job.clone(), name.clone()].to_vec(), cells(own)].concat());
        }
        let job = &rows[0].job;
        let [ms, predicted] = size.of_job(job);
        let all = [job.clone(), "all predicted".into()].to_vec();
        table.push([all, cells([ms, None, predicted])].concat());
    }
    table
}

fn cells([ms, ceiling, predicted]: [Option<f64>; 3]) -> Vec<String> {
    let ratio = ms.zip(predicted).filter(|(_, p)| *p > 0.0).map(|(ms, p)| ms / p);
    let cell =
        |value: Option<f64>, digits| value.map_or("–".into(), |value| fixed(value, digits));
    vec![cell(ms, 3), cell(ceiling, 3), cell(predicted, 3), cell(ratio, 2)]
}

/// Times of search and coding, and memory.
pub fn times(size: &Size) -> Table {
    let mut table = Table::new(["", "median ms", "95 %", "about"]);
    if let Some(ms) = size.forward_render_ms {
        table.push(["forward render".into(), fixed(ms, 2), String::new(), String::new()]);
    }
    let searches = [
        ("search, frame after frame", &size.steady),
        ("search, starts moved off", &size.perturbed_3deg),
    ];
    for (name, figures) in searches {
        if let Some(figures) = figures {
            let ms = [figures.frame_ms, figures.frame_ms_p95].map(|ms| fixed(ms, 2));
            table.push([vec![name.to_owned()], ms.to_vec(), vec![of_search(figures)]].concat());
        }
    }
    for c in &size.coding {
        let about = format!("{} frames, {:.2} dB", c.frames, c.psnr.median);
        for (what, ms) in [
            ("residual encoded", Some(&c.residual_encode_ms)),
            ("residual decoded", Some(&c.residual_decode_ms)),
            ("encoded in full", c.encode_ms.as_ref()),
            ("decoded in full", Some(&c.decode_ms)),
        ] {
            let name = format!("{what}, {} bytes", c.budget_bytes);
            let cell = |figure: fn(&Spread) -> f64| fixed_or_empty(ms.map(figure), 2);
            table.push([name, cell(|ms| ms.median), cell(|ms| ms.p95), about.clone()]);
        }
    }
    for (name, bytes) in [
        ("device memory in use, MB", size.device_memory_used_bytes),
        ("taken from the driver for it", size.device_memory_bytes),
        ("host memory so far, MB", size.host_memory_bytes),
    ] {
        let megabytes = bytes.map(|bytes| bytes as f64 / MEGA);
        table.push([name.into(), String::new(), String::new(), fixed_or_empty(megabytes, 1)]);
    }
    table
}

fn of_search(figures: &Figures) -> String {
    let Figures { trials, failures, in_forward_renders, .. } = figures;
    format!("{in_forward_renders:.1} forward renders; {failures} of {trials} failed")
}
