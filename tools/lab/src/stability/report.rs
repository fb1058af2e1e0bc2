//! The report: as Markdown and as CSV; in short on standard output.

use std::fmt::{Display, Write as _};
use std::path::Path;

use anyhow::Context as _;

use super::case::{Bench, Row, Section, Table};
use nvsprior_inputs::report;

const HEADER: [&str; 11] = [
    "case",
    "path",
    "as expected",
    "picture error, max",
    "mean",
    "by rounding inputs",
    "gradient error",
    "JᵀJ error",
    "optimiser: MSE at start → end, stop, evaluations",
    "ms",
    "note",
];

/// Words of the introduction.
const ABOUT: &str = "\
Extreme priors, pictures and numbers, each run on the device and by the f64 twin on the CPU, and compared
with what is expected. Made by `nvsprior-lab stability --report DIR`.

- *Path*: how it was run. `flow` and `exact` are the two pose Jacobians; depths are sorted exactly, except
  in `coarse`: there depths within a part in 8,000 count as equal in evaluations (as in encoders). `twin` is
  f64 throughout.
- *Picture error*: against the twin, over all channels, depth and transmittance, in units of the channel's
  largest value if that is above 1. *By rounding inputs*: how much the twin's own picture changes if every
  input moves by one unit in the last place of an f32, as the device holds it. An error is no fault if close
  decisions (alpha's cut, the transmittance stop, depth order) explain it, or sixteen times the rounding.
- *Gradient* and *JᵀJ error*: that of the largest entry, relative to its bound by Cauchy–Schwarz.
- *Optimiser*: the mean squared error, values not clamped, at a start near the true pose, and at the
  outcome. An outcome above 50 dB (MSE 1e-5) counts as found.
- Times depend on the machine's other work.
";

/// Prints one line per expectation, and the rows that are not as expected.
pub fn print_section(section: &Section) {
    println!("\n{}", section.group.name);
    let mut rows: Vec<&Row> = section.rows.iter().collect();
    while let Some(expected) = rows.first().map(|row| row.expected) {
        let (same, others): (Vec<&Row>, _) = rows.iter().partition(|row| row.expected == expected);
        let met = same.iter().filter(|row| row.as_expected()).count();
        let word = if met == same.len() { "yes" } else { "NO" };
        println!("{word:3}  {met} of {}: {expected}", same.len());
        for row in same.into_iter().filter(|row| !row.as_expected()) {
            println!("     {}, {}: {}", row.case, row.path, row.faults.join("; "));
        }
        rows = others;
    }
}

/// Writes stability.md and stability.csv.
pub fn write(folder: &Path, bench: &Bench, sections: &[Section]) -> anyhow::Result<()> {
    let path = folder.join("stability.md");
    std::fs::write(&path, markdown(bench, sections))
        .with_context(|| format!("writing {}", path.display()))?;
    csv(sections).write_csv(&folder.join("stability.csv"))
}

fn markdown(bench: &Bench, sections: &[Section]) -> String {
    let rows = || sections.iter().flat_map(|section| &section.rows);
    let met = rows().filter(|row| row.as_expected()).count();
    let mut out = String::from("# Stability\n\n");
    out.push_str(ABOUT);
    let version = env!("CARGO_PKG_VERSION");
    // Writing to a string cannot fail.
    let _ = write!(out, "\nVersion {version}, on {}.", bench.engine.device());
    let _ = writeln!(out, " {met} of {} rows are as expected.", rows().count());
    for section in sections {
        let _ = write!(out, "\n## {}\n\n{}\n", capital(section.group.name), section.group.about);
        expectations(&mut out, section);
        let _ = write!(out, "\n{}", markdown_table(&HEADER, section.rows.iter().map(cells)));
        for Table { title, about, header, rows } in &section.tables {
            let table = markdown_table(header, rows);
            let _ = write!(out, "\n### {title}\n\n{about}\n\n{table}");
        }
    }
    out
}

fn capital(name: &str) -> String {
    let mut letters = name.chars();
    letters.next().map(|first| first.to_uppercase().chain(letters).collect()).unwrap_or_default()
}

/// Prints what was expected, one line for all cases with the same expectation.
fn expectations(out: &mut String, section: &Section) {
    let mut kinds: Vec<(&str, Vec<&str>)> = Vec::new();
    for row in &section.rows {
        match kinds.iter_mut().find(|(expected, _)| *expected == row.expected) {
            Some((_, names)) if names.last() != Some(&row.case.as_str()) => names.push(&row.case),
            Some(_) => {}
            None => kinds.push((row.expected, vec![&row.case])),
        }
    }
    let _ = writeln!(out, "\nExpected:\n");
    for (expected, names) in kinds {
        let _ = writeln!(out, "- {}: *{expected}*.", names.join("; "));
    }
}

fn markdown_table<C: Display>(
    header: &[&str],
    rows: impl IntoIterator<Item = impl IntoIterator<Item = C>>,
) -> String {
    let mut table = report::Table::new(header);
    rows.into_iter().for_each(|row| table.push(row));
    table.markdown()
}

fn cells(row: &Row) -> [String; 11] {
    let figure = |v: Option<f64>| v.map_or("–".into(), |v| format!("{v:.1e}"));
    let descent = row.descent.map_or("–".into(), |d| {
        format!("{:.2e} → {:.2e}, {:?}, {}", d.start, d.end, d.stop, d.evaluations)
    });
    let note = [row.faults.join("; "), row.note.clone()];
    [
        row.case.clone(),
        row.path.to_owned(),
        if row.as_expected() { "yes" } else { "NO" }.to_owned(),
        figure(row.picture.map(|p| p.max)),
        figure(row.picture.map(|p| p.mean)),
        figure(row.picture.map(|p| p.rounding)),
        figure(row.gradient),
        figure(row.jtj),
        descent,
        format!("{:.1}", row.milliseconds),
        note.into_iter().filter(|n| !n.is_empty()).collect::<Vec<_>>().join("; "),
    ]
}

fn csv(sections: &[Section]) -> report::Table {
    let mut table = report::Table::new(["group", "expected"].iter().chain(&HEADER));
    for section in sections {
        for row in &section.rows {
            let head = [section.group.name.to_owned(), row.expected.to_owned()];
            table.push(head.into_iter().chain(cells(row)));
        }
    }
    table
}
