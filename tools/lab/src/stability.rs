//! `nvsprior-lab stability`: runs extreme priors, pictures and numbers, and compares each with what is expected.
//!
//! A group of cases is a file here, named in `GROUPS`. A case first says what is expected. Then it
//! measures, with one row for each path that it runs on.

mod case;
mod devices;
mod explained;
pub mod extremes;
mod measure;
mod optimisers;
mod pictures;
mod poses;
mod precision;
mod random;
mod refined;
mod report;
mod scenes;
mod splats;
mod units;

use std::path::PathBuf;
use std::time::Instant;

use case::{Bench, Group, Row, Section};
use nvsprior_inputs::args::{DeviceArgs, progress};
use nvsprior_inputs::values;

/// All groups, in the order of the report. To add one, add a file beside these and a line here.
const GROUPS: &[Group] = &[
    poses::GROUP,
    units::GROUP,
    optimisers::GROUP,
    splats::GROUP,
    pictures::GROUP,
    precision::GROUP,
    devices::GROUP,
    random::GROUP,
];

/// Run extreme priors, pictures and poses, and compare each with what is expected of it
///
/// Every case is drawn and differentiated on the device and by the f64 twin on the CPU. Its pose is searched for from a
/// start near the true one. Prints one line per expectation, and what is not as expected; --report writes all of it.
/// The exit code is 1 if a row is not as expected.
#[derive(clap::Args)]
pub struct Args {
    /// Folder for stability.md and stability.csv; made if it is missing
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// Smaller scenes and fewer random cases
    #[arg(long)]
    quick: bool,
    /// Only these groups
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    group: Vec<String>,
    /// Random cases [default: 10000, 50 with --quick]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(..=10_000_000))]
    cases: Option<u32>,
    /// Seed of the first random case; those after count on from it
    #[arg(long, value_name = "SEED", default_value_t = 0)]
    seed: u64,
    /// A trained scene (.ply) to measure precision on, beside the random one
    #[arg(long, value_name = "FILE")]
    prior: Option<PathBuf>,
    #[command(flatten)]
    device: DeviceArgs,
}

/// Runs the cases, prints, and writes the report.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let groups = chosen(&args.group)?;
    if let Some(folder) = &args.report {
        values::make_folder("--report", folder)?;
    }
    let bench = Bench {
        engine: args.device.open()?,
        quick: args.quick,
        random_cases: args.cases.unwrap_or(if args.quick { 50 } else { 10_000 }) as usize,
        first_seed: args.seed,
        prior: args.prior.clone(),
    };
    let sections: Vec<Section> = groups.into_iter().map(|group| section(group, &bench)).collect();
    if let Some(folder) = &args.report {
        report::write(folder, &bench, &sections)?;
    }
    args.device.check(&bench.engine)?;
    let faults = sections.iter().flat_map(|s| &s.rows).filter(|row| !row.as_expected()).count();
    anyhow::ensure!(faults == 0, "{faults} rows are not as expected");
    Ok(())
}

/// The groups asked for, or all.
fn chosen(names: &[String]) -> anyhow::Result<Vec<&'static Group>> {
    let known = || GROUPS.iter().map(|group| group.name).collect::<Vec<_>>().join(", ");
    for name in names {
        let found = GROUPS.iter().any(|group| group.name == name);
        anyhow::ensure!(found, "no group {name}; there are {}", known());
    }
    let wanted = |group: &&Group| names.is_empty() || names.iter().any(|n| n == group.name);
    Ok(GROUPS.iter().filter(wanted).collect())
}

fn section(group: &'static Group, bench: &Bench) -> Section {
    let cases = (group.cases)(bench);
    let bar = progress(cases.len(), group.name);
    let mut section = Section { group, rows: Vec::new(), tables: Vec::new() };
    for case in cases {
        bar.set_message(format!("{}: {}", group.name, case.name));
        let since = Instant::now();
        let done = (case.run)(bench).unwrap_or_else(|error| {
            let fault = format!("{error:#}");
            vec![Row { faults: vec![fault], ..Row::of("run", since) }].into()
        });
        for row in done.rows {
            let row = Row { case: case.name.clone(), expected: case.expected, ..row };
            section.rows.push(row);
        }
        section.tables.extend(done.tables);
        bar.inc(1);
    }
    bar.finish_and_clear();
    report::print_section(&section);
    section
}
