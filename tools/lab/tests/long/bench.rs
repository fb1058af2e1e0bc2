//! `nvsprior-lab bench` and `sizes`.

use serde_json::Value;

use crate::dive::{Dive, INPUT, name};
use crate::treated::{preprocessed, treated_by_hand};

/// What makes a run small.
const SMALL: &str = "--trials 3 --bfgs-frames 1 --configurations 1 --report out";

/// A finite number at a pointer.
fn number(report: &Value, at: &str) -> f64 {
    let value = report.pointer(at).and_then(Value::as_f64);
    value.filter(|v| v.is_finite()).unwrap_or_else(|| panic!("no number at {at}:\n{report:#}"))
}

fn table(dive: &Dive, name: &str) -> Vec<String> {
    let text = String::from_utf8(dive.bytes(&format!("out/{name}"))).unwrap();
    text.lines().map(str::to_owned).collect()
}

#[test]
fn bench_writes_report_tables_and_plots() {
    let dive = Dive::new();
    let offset = "--start-offset 0.03,0,0,0.5,0,0";
    let run = dive.run(&format!("bench {INPUT} {offset} {SMALL}")).ends_with(0);
    let report = dive.json("out/report.json");

    // Dives have three frames; the first does not count.
    let forward = number(&report, "/forward_render_ms");
    for (kind, trials) in [("steady", 2), ("perturbed_3deg", 3), ("perturbed_10deg", 3)] {
        let at = |figure: &str| number(&report, &format!("/{kind}/{figure}"));
        assert_eq!(at("trials"), f64::from(trials));
        assert!(at("failures") <= at("trials"));
        let (frame, ratio) = (at("frame_ms"), at("in_forward_renders"));
        assert!(frame > 0.0 && frame <= at("frame_ms_p95"), "{kind}: {frame}");
        // One is a median of ratios, the other a ratio of medians: they agree if the clock is steady.
        let expected = frame / forward;
        assert!(ratio > 0.25 * expected && ratio < 4.0 * expected, "{kind}: {ratio} {expected}");
        // Nothing is better than the best that is known.
        assert!(at("db_short/median") >= 0.0 && at("pose_error_degrees/max") >= 0.0);
        assert!(run.stdout.contains(&format!("\n{kind} ")), "{}", run.stdout);
    }
    assert_eq!(number(&report, "/steady/failures"), 0.0);
    assert_eq!(number(&report, "/steady/submissions/median"), 1.0);
    for figure in ["bytes_quality_10/median", "frames_a_second", "frames_a_second_pipelined"] {
        assert!(number(&report, &format!("/steady/{figure}")) > 0.0);
    }
    assert!(number(&report, "/bfgs/frame_ms") > number(&report, "/steady/frame_ms"));
    assert!(number(&report, "/bfgs/in_forward_renders") > 1.0);
    assert!(number(&report, "/bfgs/mse") > 0.0 && number(&report, "/bfgs/gauss_newton_mse") > 0.0);
    assert!(number(&report, "/device_memory_bytes") > 0.0);
    assert!(report["device"].as_str().unwrap().contains("Vulkan"));
    for t in 0..3 {
        assert_eq!(report["best_known"][t]["file"], name(t));
        assert!(number(&report, &format!("/best_known/{t}/psnr")) > 20.0);
    }

    let trace = table(&dive, "trace.csv");
    assert_eq!(trace[0], "optimizer,frame,evaluation,level,psnr,milliseconds");
    for row in ["gauss-newton,1,0,", "gauss-newton,2,0,", "bfgs,1,0,"] {
        assert!(trace.iter().any(|line| line.starts_with(row)), "{row}: {trace:?}");
    }
    assert_eq!(table(&dive, "frames.csv").len(), 1 + 2 + 1);
    assert_eq!(table(&dive, "trials.csv").len(), 1 + 3 + 3);
    for plot in ["trace.svg", "trials.svg", "roofline.svg", "configurations.svg"] {
        let svg = String::from_utf8(dive.bytes(&format!("out/{plot}"))).unwrap();
        assert!(svg.trim_end().ends_with("</svg>") && !svg.contains("nothing to show"), "{plot}");
    }
    stages(&report, &dive);
    commands(&report);
    configurations(&report, &dive, &run.stdout);
}

/// Rates are amounts by times, and shares of the ceilings.
fn stages(report: &Value, dive: &Dive) {
    let stages = report["stages"].as_array().unwrap();
    assert_eq!(table(dive, "stages.csv").len(), 1 + stages.len());
    let (copy, fma) = (number(report, "/ceilings/copy_bytes"), number(report, "/ceilings/flops"));
    for stage in stages {
        let at = |figure: &str| number(stage, &format!("/{figure}"));
        let seconds = at("ms") * 1e-3;
        if seconds > 0.0 {
            let shares = [at("bytes") / seconds / copy, at("flops") / seconds / fma];
            assert!((shares[0] - at("share_of_copy")).abs() < 1e-6 * (1.0 + shares[0]));
            assert!((shares[1] - at("share_of_fma")).abs() < 1e-6 * (1.0 + shares[1]));
        }
    }
    for (job, name) in [
        ("picture", "splat"),
        ("sums, flow", "splat_flow"),
        ("sums, exact", "splat_exact"),
        ("search", "splat_flow"),
        ("search", "solve"),
    ] {
        let stage = stages.iter().find(|s| s["job"] == job && s["name"] == name);
        let stage = stage.unwrap_or_else(|| panic!("{job}: no {name}"));
        assert!(number(stage, "/bytes") > 0.0 && number(stage, "/flops") > 0.0, "{stage}");
    }
}

/// Each dispatch, fill or run of copies ends with a barrier; a frame of one evaluation does not use all slots.
fn commands(report: &Value) {
    let count = |which: &str, kind: &str| number(report, &format!("/commands/{which}/{kind}"));
    for which in ["run", "unused"] {
        let [dispatches, barriers] = ["dispatches", "barriers"].map(|kind| count(which, kind));
        assert!(dispatches > 0.0 && barriers >= dispatches, "{which}: {report:#}");
    }
    assert!(count("run", "copies") > 0.0 && count("unused", "copies") == 0.0, "{report:#}");
}

/// The Pareto set is correct, and the recommended setting is the fastest one that loses little.
fn configurations(report: &Value, dive: &Dive, stdout: &str) {
    let rows = report["configurations"].as_array().unwrap();
    assert_eq!(table(dive, "configurations.csv").len(), 1 + rows.len());
    let figures =
        |row: &Value| [number(row, "/in_forward_renders/median"), number(row, "/db_short/median")];
    for row in rows {
        let [time, loss] = figures(row);
        let beaten =
            rows.iter().map(figures).any(|[t, l]| t <= time && l <= loss && (t < time || l < loss));
        assert_eq!(row["pareto"], !beaten, "{row}");
    }
    for known in ["default", "leap 0", "exact Jacobian", "splats 50 %", "bfgs"] {
        assert!(rows.iter().any(|row| row["name"] == known), "{known}");
    }
    let good = rows.iter().filter(|row| figures(row)[1] <= 0.05);
    let fastest = good.min_by(|a, b| figures(a)[0].total_cmp(&figures(b)[0])).unwrap();
    assert_eq!(report["recommended"], fastest["name"]);
    assert!(stdout.contains(&format!("recommended: {}\n", fastest["name"].as_str().unwrap())));
}

#[test]
fn bench_needs_a_run() {
    let dive = Dive::new();
    dive.run(&format!("bench {INPUT} --limit 1 {SMALL}")).ends_with(1).says("one frame is no run");
}

#[test]
fn bench_measures_sizes() {
    let dive = Dive::new();
    let width = dive.json("cameras.json")["width"].as_u64().unwrap();
    let widths = format!("--sizes-widths {},{width},{}", width / 2, 4 * width);
    let run = dive.run(&format!("bench {INPUT} --sizes {widths} --report out")).ends_with(0);
    let rows = dive.json("out/sizes.json");
    // Frames are not enlarged.
    assert_eq!(rows.as_array().unwrap().len(), 2);
    for (at, width) in [width / 2, width].into_iter().enumerate() {
        let row = &rows[at];
        assert_eq!((row["width"].as_u64(), row["frames"].as_u64()), (Some(width), Some(3)));
        for key in ["render_psnr_db", "search_ms", "render_ms", "device_bytes"] {
            assert!(number(row, &format!("/{key}")) > 0.0, "{key} of {row}");
        }
        for (index, target) in [31.0, 32.0, 33.0].into_iter().enumerate() {
            let own = |key: &str| number(row, &format!("/at_psnr/{index}/{key}"));
            assert_eq!(own("target_db"), target);
            assert!(own("bytes") > 0.0 && own("code_ms") > 0.0 && own("decode_ms") > 0.0);
            assert!(own("reached") < 3.0 || own("psnr_db") >= target, "{row}");
        }
        for (index, rate) in
            ["300 bytes", "1000 bytes", "33 dB", "quality 20", "quality 60"].iter().enumerate()
        {
            let own = |key: &str| number(row, &format!("/coder/{index}/{key}"));
            assert_eq!(row["coder"][index]["rate"], *rate);
            assert!(own("payload_bytes") > 0.0 && own("codings") >= 1.0, "{row}");
            assert!(index > 1 || own("payload_bytes") <= [300.0, 1000.0][index], "{row}");
        }
        assert!(run.stdout.contains(&format!("\n{width}×")), "{}", run.stdout);
    }
    assert_eq!(table(&dive, "sizes.csv").len(), 3);
    assert_eq!(table(&dive, "coder.csv").len(), 11);
    for plot in ["bytes", "times", "psnr"] {
        assert!(dive.bytes(&format!("out/{plot}.svg")).starts_with(b"<svg"), "{plot}");
    }
    let narrow = format!("bench {INPUT} --sizes --sizes-widths {} --report out", 2 * width);
    dive.run(&narrow).ends_with(1).says("--widths: the frames are only");
}

#[test]
fn frames_are_compared_as_the_prior_has_them_treated() {
    let best = [preprocessed(), treated_by_hand()].map(|dive| {
        let small = "--trials 0 --bfgs-frames 0 --configurations 0 --report out";
        dive.run(&format!("bench {INPUT} --starts camera-file {small}")).ends_with(0);
        dive.json("out/report.json")["best_known"].clone()
    });
    assert_eq!(best[0], best[1]);
    assert!(best[0][0]["psnr"].as_f64().is_some());
}

#[test]
fn poses_are_held_against_the_camera_files() {
    let dive = Dive::new();
    let told = dive.run(&format!("poses {INPUT} --restarts --report poses")).ends_with(0).stdout;
    assert!(told.contains("frames certain; position known in"), "{told}");
    let summary = dive.json("poses/poses.json");
    let axes = summary[0]["axes"].as_array().unwrap().len();
    assert_eq!((&summary[0]["frames"], axes), (&3.into(), 6));
    assert!(!dive.bytes("poses/poses.csv").is_empty() && !dive.bytes("poses/poses.svg").is_empty());
}
