//! How large the program is for whoever learns it: its subcommands and options, counted in its help.

use std::collections::BTreeSet;

use crate::dive::Dive;

const SUBCOMMANDS: usize = 16;
const OPTIONS: usize = 110;
/// Accepted and not shown, and no alias: `encode --optimizer gauss-newton`.
const HIDDEN: usize = 1;

/// Adds the options of a command and of those below it; how many these are.
fn count(dive: &Dive, command: &str, options: &mut BTreeSet<String>) -> usize {
    let help = dive.run(&format!("{command} --help")).ends_with(0).stdout;
    // Texts that speak of options stand further left or right.
    let long = help.lines().filter_map(|line| line.strip_prefix("      --"));
    let name = |rest: &str| rest.split([' ', '[', '.']).next().unwrap_or_default().to_owned();
    options.extend(long.map(name));
    let listed = help.split_once("\nCommands:\n").map_or("", |(_, listed)| listed);
    let listed = listed.lines().take_while(|line| !line.is_empty());
    let below: Vec<&str> = listed
        .filter_map(|line| line.strip_prefix("  ")?.split(' ').next())
        .filter(|name| !name.is_empty() && *name != "help")
        .collect();
    below.iter().for_each(|name| _ = count(dive, &format!("{command} {name}"), options));
    below.len()
}

#[test]
fn subcommands_and_options_are_few() {
    let mut options = BTreeSet::new();
    let subcommands = count(&Dive::without_frames(), "", &mut options);
    println!("{subcommands} subcommands, {} options", options.len() + HIDDEN);
    assert!(subcommands <= SUBCOMMANDS, "{subcommands} subcommands");
    assert!(options.len() > 50, "the help is read: {options:?}");
    assert!(options.len() + HIDDEN <= OPTIONS, "{}: {options:?}", options.len() + HIDDEN);
}

/// The laboratory's program may not lie beside this one while it is tested.
#[test]
fn the_laboratorys_commands_are_handed_over() {
    let dive = Dive::without_frames();
    for command in ["bench", "stability", "device-report"] {
        let run = dive.run(&format!("{command} --nonsense"));
        match run.stderr.contains("cargo build --release --bins") {
            true => run.ends_with(1).says("nvsprior-lab"),
            false => run.ends_with(2).says("--nonsense"),
        };
    }
}
