//! `nvsprior-lab device-report`.

use serde_json::Value;

use crate::dive::Dive;

/// As little as can be measured.
const SMALL: &str = "--scenes 2 --runs 1 --frames 1 --trials 1 --seconds 60";

fn number(value: &Value, at: &str) -> f64 {
    let number = value.pointer(at).and_then(Value::as_f64);
    number.unwrap_or_else(|| panic!("no number at {at}:\n{value:#}"))
}

#[test]
fn a_device_is_measured_on_one_page_and_becomes_a_row() {
    let dive = Dive::new();
    let run = dive.run(&format!("device-report --out out {SMALL}")).ends_with(0);
    let report = dive.json("out/report.json");
    assert_eq!(report["version"], 1);
    assert_eq!(report["verify"]["portable"], true);
    assert_eq!(report["failures"], Value::Array(vec![]));
    let sizes = report["sizes"].as_array().unwrap();
    let widths: Vec<f64> = sizes.iter().map(|size| number(size, "/width")).collect();
    assert_eq!(widths, [320.0, 640.0]);
    for size in sizes {
        measured(size);
    }
    assert!(number(&report, "/ceilings/copy_bytes") > 1e6);
    let text = |name: &str| String::from_utf8(dive.bytes(name)).unwrap();
    let page = text("out/index.html");
    assert_eq!(page.matches("<svg").count(), 1 + 2 * 3, "one plot of a frame, three of each size");
    assert!(page.contains(report["device"]["name"].as_str().unwrap()));
    for printed in ["portable: 4 pictures", "splat_flow", "decoded in full, 1000 bytes"] {
        assert!(run.stdout.contains(printed), "{printed}: {}", run.stdout);
        assert!(page.contains(printed), "{printed}: {page}");
    }

    let table = dive.run("device-report --table out/report.json out/report.json").ends_with(0);
    let rows: Vec<&str> = table.stdout.lines().filter(|line| line.contains(" threads")).collect();
    assert!(rows.len() == 2 && rows[0] == rows[1], "{}", table.stdout);
}

/// All of a size is there.
fn measured(size: &Value) {
    for figure in [
        "/forward_render_ms",
        "/steady/frame_ms",
        "/perturbed_3deg/frame_ms",
        "/device_memory_bytes",
        "/device_memory_used_bytes",
    ] {
        assert!(number(size, figure) > 0.0, "{figure}");
    }
    let stages = size["stages"].as_array().unwrap();
    for (job, name) in [
        ("picture", "splat"),
        ("sums, flow", "splat_flow"),
        ("search", "pyramid"),
        ("search", "solve"),
        ("search", "splat"),
    ] {
        let stage = stages.iter().find(|s| s["job"] == job && s["name"] == name);
        let stage = stage.unwrap_or_else(|| panic!("{job}: no {name}"));
        let at = |figure: &str| number(stage, &format!("/{figure}"));
        assert!(at("ms") > 0.0 && at("predicted_ms") >= at("ceiling_ms"), "{stage}");
    }
    let coding = size["coding"].as_array().unwrap();
    let budgets: Vec<f64> = coding.iter().map(|c| number(c, "/budget_bytes")).collect();
    assert_eq!(budgets, [300.0, 1000.0]);
    for c in coding {
        let median = |figure: &str| number(c, &format!("/{figure}/median"));
        assert!(median("bytes") <= number(c, "/budget_bytes"));
        let search = median("encode_ms") - median("residual_encode_ms");
        assert!(search > 0.0 && median("decode_ms") > 0.0, "{c}");
    }
    assert!(number(&coding[1], "/psnr/median") > number(&coding[0], "/psnr/median"));
}

#[test]
fn a_device_that_is_not_there_is_reported_as_failed() {
    let dive = Dive::new();
    let run = dive.run("device-report --out out --device nonsense").ends_with(1);
    let report = dive.json("out/report.json");
    assert_eq!(report["failures"][0]["what"], "device");
    assert!(report["failures"][0]["why"].as_str().unwrap().contains("nonsense"), "{report}");
    assert!(run.stdout.contains("FAILED: device"), "{}", run.stdout);
    dive.run("device-report --table out/report.json").ends_with(0);
}

#[test]
fn what_is_no_report_makes_no_row() {
    let dive = Dive::new();
    dive.run("device-report --table cameras.json").ends_with(1).says("cameras.json");
    dive.run("device-report --into devices.md").ends_with(2);
}
