//! `nvsprior-lab ablation`.

use std::collections::HashMap;

use serde_json::Value;

use crate::dive::{Dive, FRAMES, INPUT};

/// Small pictures, as Adam takes up to 1000 renders per start.
const SMALL: &str = "--trials 2 --adam-trials 1 --units 0.3 \
                     --width 80 --report out";

/// A row of a table by the names of its columns.
type Row = HashMap<String, String>;

fn rows(dive: &Dive, name: &str, columns: &str) -> Vec<Row> {
    let text = String::from_utf8(dive.bytes(&format!("out/{name}"))).unwrap();
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some(columns));
    let names = || columns.split(',').map(str::to_owned);
    lines.map(|line| names().zip(line.split(',').map(str::to_owned)).collect()).collect()
}

fn number(row: &Row, name: &str) -> f64 {
    let value = row[name].parse::<f64>().ok().filter(|v| v.is_finite());
    value.unwrap_or_else(|| panic!("{name} is no number: {row:?}"))
}

const FIGURES: &str = "method,loss,render_psnr,db_short,found,energy,bytes,iterations,full_renders,\
                       milliseconds,in_forward_renders,pose_error_units,pose_error_degrees,stop";

/// What holds of every row.
fn check(row: &Row) {
    let (psnr, short) = (number(row, "render_psnr"), number(row, "db_short"));
    assert!((-10.0 * number(row, "energy").log10() - psnr).abs() < 0.01, "{row:?}");
    // Nothing is better than the best that is known.
    assert!(short >= 0.0, "{row:?}");
    assert_eq!(row["found"] == "true", short <= 0.1, "{row:?}");
    for positive in ["bytes", "iterations", "full_renders", "milliseconds", "in_forward_renders"] {
        assert!(number(row, positive) > 0.0, "{positive}: {row:?}");
    }
}

#[test]
fn ablation_writes_every_trial_summary_and_plots() {
    let dive = Dive::new();
    let run = dive.run(&format!("ablation {INPUT} {SMALL}")).ends_with(0);

    let first = "kind,trial,file,axis,perturbation,size,unit";
    let trials = rows(&dive, "ablation.csv", &format!("{first},{FIGURES}"));
    // Two kinds, two starts of three methods and one of two.
    assert_eq!(trials.len(), 2 * (2 * 3 + 2));
    for row in &trials {
        check(row);
        let limit = if row["kind"] == "rotation" { 40.0 } else { 0.3 };
        let (value, size) = (number(row, "perturbation"), number(row, "size"));
        assert!(size == value.abs() && size <= limit, "{row:?}");
        let same = |other: &&Row| other["kind"] == row["kind"] && other["trial"] == row["trial"];
        let starts = trials.iter().filter(same);
        assert!(
            { starts }
                .all(|o| o["perturbation"] == row["perturbation"] && o["axis"] == row["axis"])
        );
    }
    for kind in ["rotation", "translation"] {
        let of = |method: &str| {
            let wanted = |r: &&Row| r["kind"] == kind && r["trial"] == "0" && r["method"] == method;
            trials.iter().find(wanted).unwrap_or_else(|| panic!("{kind}: no {method}"))
        };
        let (adam, both) = (of("adam"), of("adam-bfgs"));
        assert!(number(both, "iterations") > number(adam, "iterations"));
        assert!(number(both, "energy") <= number(adam, "energy") * 1.001);
        assert_eq!((&*of("matching")["loss"], &*of("bfgs")["loss"]), ("matching", "mse"));
        assert!(run.stdout.contains(&format!("\n{kind} by up to ")), "{}", run.stdout);
    }

    let starts = rows(&dive, "ablation-starts.csv", &format!("source,file,{FIGURES}"));
    assert_eq!(starts.len(), 2 * 2 * (FRAMES - 1));
    for row in &starts {
        check(row);
        // In pictures as small as these BFGS may stop in a local minimum near the best pose.
        let max = if row["method"] == "gauss-newton" { 0.1 } else { 0.5 };
        assert!(number(row, "db_short") <= max, "{row:?}");
    }
    summary(&dive, &trials);
    for plot in ["losses.svg", "optimizers.svg"] {
        let svg = String::from_utf8(dive.bytes(&format!("out/{plot}"))).unwrap();
        assert!(svg.trim_end().ends_with("</svg>") && !svg.contains("nothing to show"), "{plot}");
    }
}

/// The bins hold every trial once, and their quartiles are in order.
fn summary(dive: &Dive, trials: &[Row]) {
    let summary = dive.json("out/ablation.json");
    let bins = summary["bins"].as_array().unwrap();
    let count = |name: &str| bins.iter().map(|bin| bin[name].as_u64().unwrap()).sum::<u64>();
    assert_eq!(count("trials"), trials.len() as u64);
    let found = trials.iter().filter(|row| row["found"] == "true").count();
    assert_eq!(count("found"), found as u64);
    for bin in bins.iter().filter(|bin| bin["trials"] != 0) {
        for figure in ["render_psnr", "energy", "bytes", "iterations", "in_forward_renders"] {
            let at = |name: &str| bin[figure][name].as_f64().unwrap();
            let [first, median, third] = ["first_quartile", "median", "third_quartile"].map(at);
            assert!(first <= median && median <= third, "{figure}: {bin}");
        }
    }
    let sources: Vec<&Value> =
        summary["starts"].as_array().unwrap().iter().map(|s| &s["source"]).collect();
    assert_eq!(sources, ["previous", "previous", "external", "external"]);
}

#[test]
fn ablation_flags_are_checked_first() {
    let dive = Dive::new();
    for (flags, says) in [
        ("--trials 0", "--trials"),
        ("--units 0", "must be above 0"),
        ("--units inf", "must be above 0"),
    ] {
        dive.run(&format!("ablation {INPUT} {flags}")).ends_with(2).says(says);
    }
}
