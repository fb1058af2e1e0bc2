//! `nvsprior bench --codecs`: other coders beside ours.

use serde_json::Value;

use crate::dive::Dive;

const RUN: &str =
    "bench --codecs --prior prior.ply --cameras cameras.json --split dive --report out";

fn rows<'a>(rows: &'a Value, coder: &str, input: &str) -> Vec<&'a Value> {
    let all = rows.as_array().unwrap().iter();
    all.filter(|row| row["coder"] == coder && row["input"] == input).collect()
}

#[test]
fn codecs_are_measured_on_frames_and_differences() {
    let dive = Dive::new();
    let run = dive.run(RUN).ends_with(0);
    let report = dive.json("out/codecs.json");
    let number = |row: &Value, name: &str| row[name].as_f64().unwrap_or(f64::NAN);
    for input in ["frame", "difference"] {
        let webp = rows(&report, "webp", input);
        assert!(webp.len() > 3);
        for pair in webp.windows(2) {
            assert!(number(pair[1], "bytes") >= number(pair[0], "bytes"), "{input}: {pair:?}");
            assert!(number(pair[1], "psnr") > number(pair[0], "psnr") - 0.5, "{input}: {pair:?}");
        }
        assert!(webp.iter().all(|row| row["mode"] == "intra" && number(row, "encode_ms") > 0.0));
    }
    // The latent part goes with each difference picture.
    assert!(rows(&report, "webp", "difference").iter().all(|row| number(row, "bytes") > 31.0));
    // Every coder is measured, or named with what it needs.
    for coder in ["jpeg-xl", "x264", "x265", "libaom", "svt-av1"] {
        let of_coder = |row: &&Value| row["coder"] == coder;
        let row = report.as_array().unwrap().iter().find(of_coder).unwrap();
        assert_eq!(
            row["missing"].is_string(),
            run.stdout.contains(&format!("{coder}: not installed"))
        );
        assert!(row["missing"].is_string() || number(row, "psnr") > 10.0, "{row}");
    }
    assert!(dive.path("out/codecs.csv").exists() && dive.path("out/codecs.svg").exists());
}

#[test]
fn codecs_exclude_other_measurements() {
    let dive = Dive::new();
    dive.run(&format!("{RUN} --ablation")).ends_with(2);
}
