//! `nvsprior-lab codecs`: other coders beside ours.

use serde_json::{Value, json};

use crate::dive::{Dive, FRAMES};
use crate::paper::give;

const RUN: &str = "codecs --prior prior.ply --cameras cameras.json --split dive --report out";

/// Coders that are programs of their own.
const OTHERS: [&str; 6] = ["jpeg-xl", "x264", "x265", "libaom", "svt-av1", "vvenc"];

fn number(row: &Value, name: &str) -> f64 {
    row[name].as_f64().unwrap_or(f64::NAN)
}

fn rows<'a>(rows: &'a Value, coder: &str, input: &str) -> Vec<&'a Value> {
    let all = rows.as_array().unwrap().iter();
    all.filter(|row| row["coder"] == coder && row["input"] == input).collect()
}

#[test]
fn codecs_are_measured_on_frames_and_differences() {
    let dive = Dive::new();
    let run = dive.run(RUN).ends_with(0);
    let report = dive.json("out/codecs.json");
    for input in ["frame", "difference"] {
        let webp = rows(&report, "webp", input);
        assert!(webp.len() > 3);
        for pair in webp.windows(2) {
            // Libwebp's neighbouring qualities may differ by a byte either way on small pictures.
            assert!(number(pair[1], "bytes") > number(pair[0], "bytes") - 2.0, "{input}: {pair:?}");
            assert!(number(pair[1], "psnr") > number(pair[0], "psnr") - 0.5, "{input}: {pair:?}");
        }
        assert!(webp.iter().all(|row| row["mode"] == "intra" && number(row, "encode_ms") > 0.0));
    }
    // Every coder is measured, or named with what it needs.
    let absent = dive.json("out/codecs-missing.json");
    for coder in OTHERS {
        let of_coder = |row: &&Value| row["coder"] == coder;
        let missing = absent.as_array().unwrap().iter().find(of_coder);
        assert_eq!(missing.is_some(), run.stdout.contains(&format!("{coder}: not")));
        match report.as_array().unwrap().iter().find(of_coder) {
            Some(row) => assert!(missing.is_none() && number(row, "psnr") > 10.0, "{row}"),
            None => assert!(missing.unwrap()["missing"].is_string(), "{coder}"),
        }
    }
    assert!(dive.path("out/codecs.csv").exists() && dive.path("out/codecs.svg").exists());
}

#[test]
fn the_coders_built_in_need_no_other_program() {
    let dive = Dive::new();
    let nothing = dive.path("nothing");
    std::fs::create_dir(&nothing).unwrap();
    let run = dive.run_with(RUN, &[("PATH", nothing.to_str().unwrap())]).ends_with(0);
    let report = dive.json("out/codecs.json");
    for row in report.as_array().unwrap() {
        assert!(["frame", "difference"].iter().any(|input| row["input"] == *input), "{row}");
        assert_eq!(row["mode"], "intra", "{row}");
        for name in ["setting", "bytes", "psnr", "encode_ms", "decode_ms"] {
            assert!(number(row, name) >= 0.0, "{name}: {row}");
        }
        // Latent part, length and check of a steady packet go with each difference picture.
        assert!(row["input"] == "frame" || number(row, "bytes") > 22.0, "{row}");
    }
    for (coder, inputs) in [
        ("wavelet", &["frame", "difference"][..]),
        ("wavelet tuned to ssim", &["difference"]),
        ("wavelet tuned to detection", &["difference"]),
        ("webp", &["frame", "difference"]),
        ("affine-webp", &["difference"]),
        ("found-affine-webp", &["difference"]),
    ] {
        for input in inputs {
            let points = rows(&report, coder, input);
            assert!(points.len() > 3, "{coder}: {points:?}");
            let (first, last) = (points[0], points[points.len() - 1]);
            for name in ["psnr", "ssim"] {
                assert!(number(last, name) > number(first, name), "{coder}, {input}: {name}");
            }
        }
    }
    for coder in OTHERS {
        assert!(run.stdout.contains(&format!("{coder}: not installed")), "{coder}");
    }
    let rates = String::from_utf8(dive.bytes("out/codecs-rates.csv")).unwrap();
    assert!(rates.starts_with("coder,input,mode,wavelet_bd_rate,bytes_at_30_db"), "{rates}");
    let alike = String::from_utf8(dive.bytes("out/codecs-similarity.csv")).unwrap();
    assert!(alike.starts_with("coder,ssim_at_100_bytes,ssim_at_300_bytes"), "{alike}");
    assert!(alike.contains("\nwavelet,") && alike.contains("\nwebp,"), "{alike}");
}

#[test]
fn differences_leave_out_frames_streams_and_warps() {
    let dive = Dive::new();
    let nothing = dive.path("nothing");
    std::fs::create_dir(&nothing).unwrap();
    let path = [("PATH", nothing.to_str().unwrap())];
    dive.run_with(&format!("{RUN} --differences"), &path).ends_with(0);
    let report = dive.json("out/codecs.json");
    let report = report.as_array().unwrap();
    for row in report {
        assert!(row["input"] == "difference" && row["mode"] == "intra", "{row}");
        assert_ne!(row["coder"], "found-affine-webp");
    }
    for coder in ["wavelet", "wavelet tuned to ssim", "webp"] {
        assert!(report.iter().any(|row| row["coder"] == coder), "{coder}");
    }
}

#[test]
fn a_coder_outside_gets_its_points() {
    let dive = Dive::new();
    let nothing = dive.path("nothing");
    std::fs::create_dir(&nothing).unwrap();
    let path = [("PATH", nothing.to_str().unwrap())];
    let run = format!("{RUN} --differences");
    dive.run_with(&run, &path).ends_with(0);
    for (setting, least) in [("coarse", 40), ("fine", 80)] {
        let about = json!({ "of": "differences", "setting": setting });
        give(&dive, &format!("mine@{setting}"), "differences", &about, least);
    }
    give(&dive, "plain", "frames", &json!({ "of": "frames" }), 900);
    dive.run_with(&format!("{run} --learned learned"), &path).ends_with(0);
    let report = dive.json("out/codecs.json");
    let mine = rows(&report, "mine", "difference");
    let mean = 10.0 * (FRAMES - 1) as f64 / 2.0;
    let bytes: Vec<f64> = mine.iter().map(|row| number(row, "bytes")).collect();
    assert_eq!(bytes, [40.0 + mean + 22.0, 80.0 + mean + 22.0], "a steady packet's bytes, too");
    assert!(mine.iter().all(|row| number(row, "psnr") > 48.0), "{mine:?}");
    let plain = rows(&report, "plain", "frame");
    assert_eq!(number(plain[0], "bytes"), 900.0 + mean);
    let table = String::from_utf8(dive.bytes("out/codecs-rates.csv")).unwrap();
    assert!(table.lines().any(|line| line.starts_with("mine,difference,intra")), "{table}");
}
