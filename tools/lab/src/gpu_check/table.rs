//! The report as the table of `docs/experiments/gpu-check.md`, and the comparison of the two.

use super::row::Row;
use nvsprior_inputs::report::{Table, between, fixed};

const BEGIN: &str = "<!-- gpu-check: written by `make gpu-check RENEW=1` -->\n";
const END: &str = "<!-- gpu-check: end -->\n";

/// The rows of one size of subgroups. A stage whose variants show the same has one row.
pub fn table(rows: &[Row], subgroup: u32) -> Table {
    let mut table = Table::new([
        "pipeline",
        "module",
        "workgroup",
        "lanes used",
        "registers",
        "scalar registers",
        "shared bytes",
        "occupancy",
        "spills",
        "instructions",
    ]);
    let rows: Vec<&Row> = rows.iter().filter(|row| row.subgroup == subgroup).collect();
    for (at, row) in rows.iter().enumerate() {
        let variants = |row: &&&Row| row.stage == rows[at].stage;
        if rows.iter().filter(variants).any(|other| cells(other) != cells(row)) {
            table.push([vec![row.name()], cells(row)].concat());
        } else if !rows[..at].iter().any(|before| before.stage == row.stage) {
            table.push([vec![row.stage.clone()], cells(row)].concat());
        }
    }
    table
}

/// All cells but the name.
fn cells(row: &Row) -> Vec<String> {
    vec![
        row.module.clone(),
        row.workgroup.to_string(),
        share(row.lanes_used),
        row.registers.to_string(),
        row.scalar_registers.to_string(),
        row.shared_bytes.to_string(),
        share(row.occupancy),
        row.spills.to_string(),
        row.instructions.to_string(),
    ]
}

/// A share as percents, with a digit more if it is small.
fn share(share: f64) -> String {
    let percent = share * 100.0;
    fixed(percent, usize::from(percent < 10.0)) + " %"
}

/// The part of the document that is written.
pub fn section(rows: &[Row]) -> String {
    let compiler = rows.first().map_or("", |row| row.compiler.as_str());
    let mut subgroups: Vec<u32> = rows.iter().map(|row| row.subgroup).collect();
    subgroups.sort_unstable();
    subgroups.dedup();
    let mut text = format!("{BEGIN}Compiled by {compiler} for NAVI21.\n");
    for subgroup in subgroups {
        let own = table(rows, subgroup).markdown();
        text += &format!("\n### Subgroups of {subgroup}\n\n{own}");
    }
    text + "\n" + END
}

/// The document with another section in the place of its own; `None` if it has none.
pub fn renewed(document: &str, section: &str) -> Option<String> {
    let old = between(document, BEGIN, END)?;
    Some(document.replacen(old, section, 1))
}

/// How a document's figures differ from the measured ones.
#[derive(Debug, PartialEq)]
pub enum Comparison {
    Same,
    /// Lines that are in the document only, and lines that are missing there.
    Different {
        before: Vec<String>,
        now: Vec<String>,
    },
    /// They are of another compiler.
    OtherCompiler(String),
    /// The document has no such part.
    None,
}

/// Compares a document with a section.
pub fn compare(document: &str, section: &str) -> Comparison {
    let Some(before) = between(document, BEGIN, END) else { return Comparison::None };
    if before == section {
        return Comparison::Same;
    }
    let compiler = |text: &str| text.lines().nth(1).unwrap_or_default().to_owned();
    if compiler(before) != compiler(section) {
        return Comparison::OtherCompiler(compiler(before));
    }
    let [before, now] = [before, section].map(lines);
    let without = |all: &[String], others: &[String]| {
        all.iter().filter(|line| !others.contains(line)).cloned().collect()
    };
    Comparison::Different { before: without(&before, &now), now: without(&now, &before) }
}

/// The rows of a section, each below its heading's name.
fn lines(section: &str) -> Vec<String> {
    let mut heading = "";
    let mut lines = Vec::new();
    for line in section.lines() {
        heading = line.strip_prefix("### ").unwrap_or(heading);
        if line.starts_with('|') {
            lines.push(format!("{heading}: {line}"));
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(stage: &str, subgroup: u32) -> Row {
        Row {
            compiler: "Mesa 1.2".into(),
            stage: stage.into(),
            module: stage.into(),
            subgroup,
            compiled_subgroup: subgroup,
            workgroup: 32,
            lanes_used: 32.0 / f64::from(subgroup),
            registers: 48,
            scalar_registers: 38,
            spills: 0,
            shared_bytes: 1024,
            occupancy: 21.0 / 32.0,
            instructions: 531,
            ..Row::default()
        }
    }

    fn document() -> (String, String) {
        let section = section(&[row("splat", 32), row("splat", 64)]);
        (format!("# Title\n\n{section}\nMore.\n"), section)
    }

    #[test]
    fn statistics_stand_in_the_table() {
        let (document, _) = document();
        let line = "| splat | splat | 32 | 100 % | 48 | 38 | 1024 | 66 % | 0 | 531 |";
        assert!(document.contains(line), "{document}");
        assert!(document.contains(&line.replace("100 %", "50 %")), "{document}");
        assert!(document.contains("Mesa 1.2") && document.contains("### Subgroups of 64"));
    }

    #[test]
    fn variants_that_show_the_same_have_one_row() {
        let variant = |variant: &str, instructions| Row {
            variant: variant.into(),
            instructions,
            ..row("splat", 32)
        };
        let names = |rows: &[Row]| {
            let text = table(rows, 32).only(&["pipeline"]).markdown();
            text.lines()
                .skip(2)
                .map(|line| line.trim_matches(['|', ' ']).to_owned())
                .collect::<Vec<_>>()
        };
        let rows = [variant("clamp", 5), variant("no clamp", 5), row("solve", 32)];
        assert_eq!(names(&rows), ["splat", "solve"]);
        let rows = [variant("clamp", 5), variant("no clamp", 4)];
        assert_eq!(names(&rows), ["splat, clamp", "splat, no clamp"]);
    }

    #[test]
    fn the_same_figures_are_the_same() {
        let (document, section) = document();
        assert_eq!(compare(&document, &section), Comparison::Same);
        assert_eq!(compare("# Title\n", &section), Comparison::None);
    }

    #[test]
    fn a_changed_row_is_shown_with_its_size_of_subgroups() {
        let (document, _) = document();
        let more = Row { instructions: 532, ..row("splat", 64) };
        let now = section(&[row("splat", 32), more]);
        let Comparison::Different { before, now: after } = compare(&document, &now) else {
            panic!("not different")
        };
        assert_eq!((before.len(), after.len()), (1, 1));
        assert!(after[0].starts_with("Subgroups of 64: | splat") && after[0].contains("| 532 |"));
        assert_eq!(compare(&renewed(&document, &now).unwrap(), &now), Comparison::Same);
    }

    #[test]
    fn figures_of_another_compiler_are_not_compared() {
        let (document, _) = document();
        let now = section(&[Row { compiler: "Mesa 1.3".into(), ..row("splat", 32) }]);
        assert!(
            matches!(compare(&document, &now), Comparison::OtherCompiler(text) if text.contains("1.2"))
        );
    }
}
