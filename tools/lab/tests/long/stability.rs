//! `nvsprior-lab stability`.

use crate::dive::Dive;

#[test]
fn quick_report_is_as_expected() {
    let dive = Dive::new();
    let run = dive.run("stability --quick --report out").ends_with(0);
    let text = |name: &str| String::from_utf8(dive.bytes(&format!("out/{name}"))).unwrap();
    let (report, csv) = (text("stability.md"), text("stability.csv"));
    for heading in ["# Stability", "## Splats", "## Pictures", "## Precision", "## Random"] {
        assert!(report.contains(heading), "{heading}: {report}");
    }
    for case in ["needles, axis ratio 1e6", "1×1", "170° across", "50000 splats in one tile"] {
        let rows = csv.lines().filter(|line| line.contains(case)).count();
        assert!(rows >= 4, "{case}: {rows} rows");
    }
    assert!(report.contains("Bits right by stage: random"), "{report}");
    assert!(!run.stdout.contains("\nNO "), "{}", run.stdout);
}

#[test]
fn unknown_groups_are_refused() {
    let dive = Dive::new();
    dive.run("stability --group nonsense").ends_with(1).says("no group nonsense");
}
