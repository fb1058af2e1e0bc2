//! `make gpu-check`: what a GPU's compiler makes of the engine's pipelines, without a GPU. Mesa's RADV compiles for a
//! GPU that is not in the machine, at subgroups of 32 and of 64. Nothing is submitted to that device:
//! `docs/latency.md`.

mod lanes;
mod row;
mod table;

use std::path::PathBuf;
use std::process::{Command, ExitCode, Stdio};

use anyhow::Context as _;
use nvsprior::render::inspection;
use nvsprior::vulkan::Device;

use lanes::{IDLE, Idle};
use nvsprior_inputs::report::write_json;
use row::Row;
use table::Comparison;

/// Ask a GPU's compiler about the engine's pipelines, without a GPU
///
/// Writes target/gpu-check/report.json. Fails if a pipeline spills registers, if it leaves lanes idle and is no known
/// exception, or if the figures are not those of docs/experiments/gpu-check.md.
#[derive(clap::Parser)]
pub struct Args {
    /// Writes the table of docs/experiments/gpu-check.md anew
    #[arg(long)]
    renew: bool,
    /// The document with the table
    #[arg(long, value_name = "FILE", default_value = "docs/experiments/gpu-check.md")]
    document: PathBuf,
    /// The folder that report.json is written to
    #[arg(long, value_name = "DIR", default_value = "target/gpu-check")]
    report: PathBuf,
    /// Prints the rows of one size of subgroups as JSON; the driver must have been told that size
    #[arg(long, value_name = "SIZE", hide = true)]
    compile: Option<u32>,
}

/// Part of the name of the device without hardware.
const NULL_DEVICE: &str = "Null hardware";

/// Checks; the exit code says whether all is well.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    if let Some(subgroup) = args.compile {
        println!("{}", serde_json::to_string(&compile(subgroup)?)?);
        return Ok(ExitCode::SUCCESS);
    }
    let mut rows = in_child(32)?;
    rows.extend(in_child(64)?);
    std::fs::create_dir_all(&args.report)
        .with_context(|| format!("creating {}", args.report.display()))?;
    write_json(&args.report.join("report.json"), &rows)?;
    for subgroup in [32, 64] {
        println!("\nsubgroups of {subgroup}");
        table::table(&rows, subgroup).print();
    }
    println!("\nidle lanes that are known:");
    for idle in IDLE {
        println!("  {} at subgroups of {:?}: {}", idle.module, idle.subgroups, idle.reason);
    }
    let mut faults = faults(&rows, IDLE);
    match check_document(args, &rows)? {
        // Another version may choose other sizes for small workgroups.
        Comparison::OtherCompiler(theirs) => println!(
            "\nfigures and exceptions not compared: the table of {} is of another Mesa: {theirs}",
            args.document.display()
        ),
        comparison => {
            faults.extend(stale(&rows, IDLE));
            faults.extend(fault_of(comparison, args));
        }
    }
    for fault in &faults {
        tell!("gpu-check: {fault}");
    }
    Ok(if faults.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Compiles all pipelines for subgroups of this size.
fn compile(subgroup: u32) -> anyhow::Result<Vec<Row>> {
    let device = Device::open_for_inspection(NULL_DEVICE, subgroup)
        .context("Mesa's RADV makes the device; Debian's mesa-vulkan-drivers has it")?;
    let stages = inspection::stages(&device)?;
    let heeds = stages.iter().any(|stage| stage.compiled.subgroup == subgroup);
    anyhow::ensure!(heeds, "the driver compiles nothing for subgroups of {subgroup}");
    row::rows(&stages, &device.info().driver, subgroup)
}

/// As [`compile`], in a process of its own: the driver reads its orders from the environment once.
fn in_child(subgroup: u32) -> anyhow::Result<Vec<Row>> {
    let mut command = Command::new(std::env::current_exe()?);
    command.args(["gpu-check", "--compile"]).arg(subgroup.to_string());
    command.env("RADV_FORCE_FAMILY", "navi21").env("MESA_SHADER_CACHE_DISABLE", "true");
    match subgroup {
        32 => command.env("RADV_PERFTEST", "cswave32"),
        _ => command.env_remove("RADV_PERFTEST"),
    };
    let output = command.stderr(Stdio::inherit()).output()?;
    anyhow::ensure!(output.status.success(), "compiling for subgroups of {subgroup} failed");
    serde_json::from_slice(&output.stdout).context("reading what the compiling process printed")
}

/// Spills, and idle lanes that are not known.
fn faults(rows: &[Row], exceptions: &[Idle]) -> Vec<String> {
    let mut faults = Vec::new();
    for row in rows {
        let Row { subgroup, spills, lanes_used, .. } = row;
        let name = row.name();
        if *spills > 0 {
            faults.push(format!("{name} spills {spills} registers at subgroups of {subgroup}"));
        }
        let known = exceptions.iter().any(|idle| is_of(idle, row));
        if *lanes_used < 1.0 && !known {
            let used = 100.0 * lanes_used;
            faults.push(format!("{name} uses {used:.0} % of its lanes at subgroups of {subgroup}"));
        }
    }
    faults
}

/// Exceptions that are none any more.
fn stale(rows: &[Row], exceptions: &[Idle]) -> Vec<String> {
    let mut stale = Vec::new();
    for Idle { module, subgroups, .. } in exceptions {
        for subgroup in *subgroups {
            let own = |row: &&Row| row.module == *module && row.subgroup == *subgroup;
            if !rows.iter().filter(own).any(|row| row.lanes_used < 1.0) {
                stale.push(format!(
                    "{module} has no idle lanes at subgroups of {subgroup}, and is an exception in \
                     tools/lab/src/gpu_check/lanes.rs"
                ));
            }
        }
    }
    stale
}

fn is_of(idle: &Idle, row: &Row) -> bool {
    idle.module == row.module && idle.subgroups.contains(&row.subgroup)
}

/// Renews the document, or compares it.
fn check_document(args: &Args, rows: &[Row]) -> anyhow::Result<Comparison> {
    let path = &args.document;
    let reading = || format!("reading {}", path.display());
    let document = std::fs::read_to_string(path).with_context(reading)?;
    let section = table::section(rows);
    if args.renew {
        let renewed = table::renewed(&document, &section)
            .with_context(|| format!("{} has no place for the table", path.display()))?;
        std::fs::write(path, renewed).with_context(|| format!("writing {}", path.display()))?;
        return Ok(Comparison::Same);
    }
    Ok(table::compare(&document, &section))
}

/// What is wrong if the figures of the document differ.
fn fault_of(comparison: Comparison, args: &Args) -> Option<String> {
    let path = args.document.display();
    match comparison {
        Comparison::Same | Comparison::OtherCompiler(_) => None,
        Comparison::None => Some(format!("{path} has no table")),
        Comparison::Different { before, now } => {
            let before = before.iter().map(|line| format!("- {line}"));
            let lines: Vec<_> = before.chain(now.iter().map(|line| format!("+ {line}"))).collect();
            let lines = lines.join("\n");
            Some(format!("{path} has other figures; `make gpu-check RENEW=1` renews it:\n{lines}"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(module: &str, subgroup: u32, lanes_used: f64, spills: u32) -> Row {
        Row {
            module: module.into(),
            stage: module.into(),
            subgroup,
            lanes_used,
            spills,
            ..Row::default()
        }
    }

    const SOLVE: &[Idle] = &[Idle { module: "solve", subgroups: &[32, 64], reason: "one" }];

    #[test]
    fn spills_and_unknown_idle_lanes_are_faults() {
        let rows = [
            row("solve", 32, 0.1, 0),
            row("project", 32, 1.0, 2),
            row("splat", 64, 0.5, 0),
            row("reduce", 32, 1.0, 0),
        ];
        assert_eq!(
            faults(&rows, SOLVE),
            [
                "project spills 2 registers at subgroups of 32",
                "splat uses 50 % of its lanes at subgroups of 64"
            ]
        );
    }

    #[test]
    fn an_exception_that_is_full_or_gone_is_a_fault() {
        let idle = [row("solve", 32, 0.1, 0), row("solve", 64, 0.1, 0)];
        assert!(stale(&idle, SOLVE).is_empty());
        let [full, gone] = [&[row("solve", 64, 1.0, 0), idle[0].clone()], &idle[..1]]
            .map(|rows| stale(rows, SOLVE));
        assert_eq!(full, gone);
        assert!(full[0].starts_with("solve has no idle lanes at subgroups of 64"), "{full:?}");
    }
}
