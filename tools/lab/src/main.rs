//! `nvsprior-lab`: measures the engine, and everything that it is compared with.

#[macro_use]
extern crate nvsprior_inputs;

use std::ffi::OsString;
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use nvsprior_channel::link;
use nvsprior_inputs::values::WrongUsage;
use nvsprior_lab::bench::{
    self, ablation, codecs, frame_times, poses, recovery, scaling, site, sizes,
};
use nvsprior_lab::{device_report, draw, gpu_check, paper, stability};

/// The laboratory of nvsprior: run time and error, comparisons, and scenes to measure on.
///
/// Exit codes: 0 done, 1 something failed (named on standard error), 2 wrong usage.
#[derive(Parser)]
#[command(name = "nvsprior-lab", version, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Bench(bench::Args),
    Codecs(codecs::Args),
    Site(site::Args),
    Ablation(ablation::Args),
    Recovery(recovery::Args),
    Sizes(sizes::Args),
    Poses(poses::Args),
    Scaling(scaling::Args),
    FrameTimes(frame_times::Args),
    Stability(stability::Args),
    DeviceReport(device_report::command::Args),
    Draw(draw::Args),
    #[command(subcommand)]
    Paper(paper::Command),
    Link(Box<Comparing>),
    GpuCheck(gpu_check::Args),
}

/// As `nvsprior link`, with what only comparisons ask of a link
#[derive(clap::Args)]
struct Comparing {
    #[command(flatten)]
    link: link::Args,
    #[command(flatten)]
    lab: link::LabArgs,
}

fn main() -> ExitCode {
    // If a reader closes the pipe (`| head`), the program ends without a panic.
    sigpipe::reset();
    let result = match Cli::parse_from(translated(std::env::args_os().collect())).command {
        Command::Bench(args) => bench::run(&args),
        Command::Codecs(args) => codecs::run(&args),
        Command::Site(args) => site::run(&args),
        Command::Ablation(args) => ablation::run(&args),
        Command::Recovery(args) => recovery::run(&args),
        Command::Sizes(args) => sizes::run(&args),
        Command::Poses(args) => poses::run(&args),
        Command::Scaling(args) => scaling::run(&args),
        Command::FrameTimes(args) => frame_times::run(&args),
        Command::Stability(args) => stability::run(&args),
        Command::DeviceReport(args) => return report(device_report::command::run(&args)),
        Command::Draw(args) => draw::run(&args),
        Command::Paper(command) => paper::run(&command),
        Command::Link(args) => link::run(&args.link, &args.lab),
        Command::GpuCheck(args) => return report(gpu_check::run(&args)),
    };
    report(result.map(|()| ExitCode::SUCCESS))
}

/// The exit code; names what failed.
fn report(result: anyhow::Result<ExitCode>) -> ExitCode {
    result.unwrap_or_else(|error| {
        tell!("nvsprior-lab: {error:#}");
        if error.is::<WrongUsage>() { ExitCode::from(2) } else { ExitCode::FAILURE }
    })
}

/// The flags that `bench` had for measurements that are commands of their own, and the option that takes the flag's
/// value.
const FLAGS: [(&str, &str); 9] = [
    ("codecs", ""),
    ("site", ""),
    ("ablation", ""),
    ("recovery", ""),
    ("sizes", ""),
    ("paper", ""),
    ("scaling", ""),
    ("poses", "--conditions"),
    ("frame-times", "--bound"),
];

/// The arguments, with `bench --codecs` and its like as `codecs`. Says so.
fn translated(args: Vec<OsString>) -> Vec<OsString> {
    if args.get(1).is_none_or(|command| command != "bench") {
        return args;
    }
    let given = |(name, _): &(&str, &str)| {
        args.iter().any(|arg| value_of(name, arg).is_some_and(|value| !value.starts_with('-')))
    };
    let Some((name, option)) = FLAGS.into_iter().find(given) else { return args };
    let command = if name == "paper" { "paper bench" } else { name };
    tell!("nvsprior-lab: `bench --{name}` is `nvsprior-lab {command}`");
    let mut all = vec![args[0].clone()];
    all.extend(command.split(' ').map(OsString::from));
    for arg in &args[2..] {
        match value_of(name, arg) {
            Some("") => {}
            Some(value) if value.starts_with('=') => all.push(format!("{option}{value}").into()),
            Some("-starts") => all.push("--restarts".into()),
            // `--sizes-widths` is `--widths` of `sizes`.
            Some(rest) if rest.starts_with('-') => all.push(format!("-{rest}").into()),
            _ => all.push(arg.clone()),
        }
    }
    all
}

/// What follows `--NAME` in an argument that begins so.
fn value_of<'a>(name: &str, arg: &'a OsString) -> Option<&'a str> {
    arg.to_str()?.strip_prefix("--")?.strip_prefix(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flags_of_bench_are_commands() {
        let translate = |args: &str| {
            let args = args.split(' ').map(OsString::from).collect();
            translated(args)
                .into_iter()
                .map(|arg| arg.into_string().unwrap())
                .collect::<Vec<_>>()
                .join(" ")
        };
        for (old, new) in [
            ("lab bench --prior a --codecs --differences", "lab codecs --prior a --differences"),
            ("lab bench --site --site-parts 6 --report OUT", "lab site --parts 6 --report OUT"),
            ("lab bench --paper --learned x", "lab paper bench --learned x"),
            ("lab bench --poses=silt --poses-starts", "lab poses --conditions=silt --restarts"),
            ("lab bench --poses --report x", "lab poses --report x"),
            ("lab bench --frame-times=40", "lab frame-times --bound=40"),
            ("lab bench --recovery --recovery-only=roll", "lab recovery --only=roll"),
            ("lab bench --starts none --trials 3", "lab bench --starts none --trials 3"),
            ("lab codecs --site", "lab codecs --site"),
        ] {
            assert_eq!(translate(old), new);
        }
    }
}
