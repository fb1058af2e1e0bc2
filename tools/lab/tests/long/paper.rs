//! `nvsprior-lab paper bench`: the paper's rows, and what `tools/paper` gives and gets.

use nvsprior::prior::KeyFrames;
use serde_json::{Value, json};

use crate::dive::{Dive, FRAMES, save};
use crate::scene::{CAMERA, pose, wall, write_prior};

const RUN: &str = "paper bench --prior prior.ply --cameras cameras.json --split dive";

/// Rows that are there in any case, in their order.
const METHODS: [&str; 16] = [
    "webp",
    "jpeg-xl",
    "mean-scale-hyperprior",
    "mlic++",
    "affine+webp",
    "affine+jpeg-xl",
    "invs+webp",
    "invs+jpeg-xl",
    "ours-intra",
    "ours-stream",
    "estimator",
    "estimator-cnn",
    "affine-cnn+webp",
    "affine-cnn+jpeg-xl",
    "mean-scale-hyperprior-differences",
    "mlic++-differences",
];
/// What `tools/paper` makes.
const OUTSIDE: [&str; 7] = [
    "mean-scale-hyperprior",
    "mlic++",
    "estimator-cnn",
    "affine-cnn+webp",
    "affine-cnn+jpeg-xl",
    "mean-scale-hyperprior-differences",
    "mlic++-differences",
];
const NUMBERS: [&str; 5] = ["bytes", "ratio", "psnr", "ssim", "setting"];
const TIMES: [&str; 2] = ["encode_ms", "decode_ms"];

fn number(row: &Value, name: &str) -> f64 {
    row[name].as_f64().unwrap_or(f64::NAN)
}

fn row<'a>(report: &'a Value, method: &str) -> &'a Value {
    let mut rows = report.as_array().unwrap().iter();
    rows.find(|row| row["method"] == method).unwrap_or(&Value::Null)
}

/// A dive whose prior has key frames.
fn dive() -> Dive {
    let dive = Dive::new();
    let poses = KeyFrames::new((0..=FRAMES).map(|t| pose(t as f64)).collect()).unwrap();
    write_prior(&dive.path("prior.ply"), &wall(1).with_key_frames(poses));
    dive
}

#[test]
fn every_row_is_measured_or_says_what_it_needs() {
    let dive = dive();
    let run = dive.run(&format!("{RUN} --report out")).ends_with(0);
    let told = |what: &str| run.stderr.contains(&format!("measuring {what}\n"));
    assert!(
        ["poses", "webp", "invs+jpeg-xl", "ours-stream"].into_iter().all(told),
        "{}",
        run.stderr
    );
    let report = dive.json("out/paper.json");
    let methods: Vec<_> =
        report.as_array().unwrap().iter().map(|row| row["method"].as_str().unwrap()).collect();
    assert_eq!(methods, METHODS);
    for row in report.as_array().unwrap() {
        let method = row["method"].as_str().unwrap();
        if let Some(missing) = row["missing"].as_str() {
            let outside = OUTSIDE.contains(&method) && missing.contains("tools/paper");
            assert!(outside || missing.contains("cjxl"), "{row}");
            continue;
        }
        assert!(!OUTSIDE.contains(&method), "{row}");
        assert_eq!(row["frames"], FRAMES, "{row}");
        let raw = f64::from(CAMERA.width * CAMERA.height * 3);
        assert!((number(row, "ratio") * number(row, "bytes") / raw - 1.0).abs() < 1e-9, "{row}");
        assert!(number(row, "psnr") > 20.0 && number(row, "ssim") > 0.5, "{row}");
        assert!(row["ms_ssim"].is_null(), "too small for five scales: {row}");
        assert!(TIMES.iter().all(|name| number(row, name) > 0.0), "{row}");
    }
    // WebP has the PSNR that the paper reports for its real footage, whose place the frames take.
    assert!((number(row(&report, "webp"), "psnr") - 32.49).abs() < 0.5);
    assert!(number(row(&report, "invs+webp"), "bytes") > 28.0);
    let (invs, affine) = (row(&report, "invs+webp"), row(&report, "affine+webp"));
    assert_eq!(invs["setting"], affine["setting"]);
    assert_eq!(row(&report, "estimator")["found"], FRAMES);

    let equal = dive.json("out/paper-equal.json");
    let target = number(invs, "psnr");
    for row in equal.as_array().unwrap().iter().filter(|row| row["missing"].is_null()) {
        let near = (number(row, "psnr") - target).abs() <= 0.05;
        assert_eq!(row["reached"], near, "{target}: {row}");
    }
    assert_eq!(row(&equal, "invs+webp")["reached"], true);
    let (ours, webp) = (row(&equal, "ours-intra"), row(&equal, "webp"));
    assert!(number(ours, "bytes") < number(webp, "bytes"), "{ours} {webp}");

    let text = String::from_utf8(dive.bytes("out/paper.md")).unwrap();
    assert!(
        text.contains("the paper reports for its IUI3-RedSea") && text.contains("1670, 103.47"),
        "{text}"
    );
    let sheet = dive.picture("out/paper.png");
    assert!(sheet.width > 3 * CAMERA.width && sheet.height > 2 * CAMERA.height);
    assert!(dive.path("out/paper.svg").exists());
}

#[test]
fn the_same_command_gives_the_same_bytes_with_or_without_other_programs() {
    let dive = dive();
    let nothing = dive.path("nothing");
    std::fs::create_dir(&nothing).unwrap();
    let path = [("PATH", nothing.to_str().unwrap())];
    dive.run(&format!("{RUN} --frames 2 --report one")).ends_with(0);
    dive.run_with(&format!("{RUN} --frames 2 --report two"), &path).ends_with(0);
    for file in ["paper.json", "paper-equal.json"] {
        let (one, two) = (dive.json(&format!("one/{file}")), dive.json(&format!("two/{file}")));
        for again in two.as_array().unwrap() {
            let method = again["method"].as_str().unwrap();
            if method.ends_with("jpeg-xl") && !OUTSIDE.contains(&method) {
                assert!(again["missing"].as_str().unwrap().contains("libjxl-tools"), "{again}");
                continue;
            }
            let first = row(&one, method);
            assert_eq!(first["missing"], again["missing"], "{method}");
            for name in NUMBERS {
                assert_eq!(first[name], again[name], "{method}, {name}");
            }
        }
    }
    for name in ["manifest.json", "frames/0.png", "renders/2.png", "differences/2.png"] {
        let [one, two] = ["one", "two"].map(|out| dive.bytes(&format!("{out}/exchange/{name}")));
        assert_eq!(one, two, "{name}");
    }
    let manifest = dive.json("one/exchange/manifest.json");
    assert_eq!(manifest["frames"], json!(["0", "2"]), "spread over the run");
    assert_eq!((&manifest["set"], &manifest["cameras"]), (&json!("dive"), &json!("cameras.json")));
    assert_eq!((&manifest["width"], &manifest["height"]), (&json!(160), &json!(90)));
    assert_eq!(manifest["prior"].as_str().unwrap().len(), 8);
}

#[test]
fn without_key_frames_the_rows_of_estimators_are_missing() {
    let dive = Dive::new();
    let nothing = dive.path("nothing");
    std::fs::create_dir(&nothing).unwrap();
    let path = [("PATH", nothing.to_str().unwrap())];
    dive.run_with(&format!("{RUN} --frames 2 --report out"), &path).ends_with(0);
    let report = dive.json("out/paper.json");
    for method in ["affine+webp", "estimator"] {
        let missing = row(&report, method)["missing"].as_str().unwrap_or_default();
        assert!(missing.contains("nvsprior key-frames"), "{method}: {missing}");
    }
    assert!(number(row(&report, "invs+webp"), "bytes") > 28.0);
    dive.run(&format!("{RUN} --starts none --report out")).ends_with(1).says("no start");
}

/// What a learned coder would give: pictures of exchange/, and made-up bytes.
fn learn(dive: &Dive, folder: &str, method: &str, of: &str, lambda: f64) {
    let about = json!({ "method": method, "lambda": lambda, "parameters": 1234, "seed": 1,
        "steps": 2, "of": of, "weights": "" });
    give(dive, folder, of, &about, 90);
}

/// What a coder outside gives: pictures of exchange/, and made-up bytes from `least` on.
pub fn give(dive: &Dive, folder: &str, of: &str, about: &Value, least: usize) {
    let folder = format!("learned/{folder}");
    std::fs::create_dir_all(dive.path(&format!("{folder}/pictures"))).unwrap();
    for t in 0..FRAMES {
        let from = dive.path(&format!("out/exchange/{of}/{t}.png"));
        std::fs::copy(from, dive.path(&format!("{folder}/pictures/{t}.png"))).unwrap();
    }
    dive.write_json(&format!("{folder}/method.json"), about);
    let rows = (0..FRAMES).map(|t| format!("{t},{},2.5,1.5\n", least + 10 * t)).collect::<String>();
    let text = format!("name,bytes,encode_ms,decode_ms\n{rows}");
    std::fs::write(dive.path(&format!("{folder}/frames.csv")), text).unwrap();
}

/// The true poses, as a regressor would write its own.
fn starts() -> String {
    let line = |t: usize| {
        let (q, p) = (pose(t as f64).wxyz(), pose(t as f64).translation);
        format!("{t},{},{},{},{},{},{},{}\n", q[0], q[1], q[2], q[3], p.x, p.y, p.z)
    };
    "name,qw,qx,qy,qz,tx,ty,tz\n".to_owned() + &(0..FRAMES).map(line).collect::<String>()
}

#[test]
fn learned_coders_and_starts_get_their_rows() {
    let dive = dive();
    let nothing = dive.path("nothing");
    std::fs::create_dir(&nothing).unwrap();
    let path = [("PATH", nothing.to_str().unwrap())];
    let run = format!("{RUN} --report out");
    dive.run_with(&run, &path).ends_with(0);
    learn(&dive, "mlic++@0.01", "mlic++", "frames", 0.01);
    learn(&dive, "mlic++@0.05", "mlic++", "frames", 0.05);
    let method = "mean-scale-hyperprior-differences";
    learn(&dive, method, method, "differences", 0.05);
    // One frame as the decoder gives it is another than the camera's.
    let mut picture = dive.picture("out/exchange/frames/0.png");
    picture.data.iter_mut().for_each(|value| *value ^= 8);
    for lambda in ["0.01", "0.05"] {
        for t in 0..FRAMES {
            save(&picture, &dive.path(&format!("learned/mlic++@{lambda}/pictures/{t}.png")));
        }
    }
    std::fs::write(dive.path("starts.csv"), starts()).unwrap();
    dive.run_with(&format!("{run} --learned learned --starts starts.csv"), &path).ends_with(0);
    let report = dive.json("out/paper.json");
    let mlic = row(&report, "mlic++");
    assert_eq!((number(mlic, "bytes"), &mlic["setting"]), (100.0, &json!("lambda 0.05")));
    assert!((15.0..31.0).contains(&number(mlic, "psnr")), "{mlic}");
    assert_eq!(row(&report, "mlic++@0.01")["setting"], "lambda 0.01");
    assert_eq!(row(&report, "mlic++@0.05"), &Value::Null, "it is in the method's own row");
    let differences = row(&report, method);
    assert_eq!(number(differences, "bytes"), 128.0, "the pose is sent, too");
    assert!(number(differences, "psnr") > 48.0, "half a level is lost: {differences}");
    assert_eq!(differences["parameters"], 1234);
    assert!(row(&report, "mean-scale-hyperprior")["missing"].is_string());
    assert_eq!(row(&report, "estimator-cnn")["found"], FRAMES);
    assert!(number(row(&report, "affine-cnn+webp"), "bytes") > 52.0);
}

/// Pictures that are so many levels off.
fn worsen(dive: &Dive, folder: &str, levels: u8) {
    for t in 0..FRAMES {
        let path = format!("learned/{folder}/pictures/{t}.png");
        let mut picture = dive.picture(&path);
        picture.data.iter_mut().for_each(|v| *v = if *v < 128 { *v + levels } else { *v - levels });
        save(&picture, &dive.path(&path));
    }
}

#[test]
fn a_coder_of_any_name_gets_its_rows() {
    let dive = dive();
    let nothing = dive.path("nothing");
    std::fs::create_dir(&nothing).unwrap();
    let path = [("PATH", nothing.to_str().unwrap())];
    let run = format!("{RUN} --report out");
    dive.run_with(&run, &path).ends_with(0);
    let target = number(row(&dive.json("out/paper.json"), "invs+webp"), "psnr");
    // A constant error of `levels` has this PSNR.
    let levels = |psnr: f64| 255.0 / 10f64.powf(psnr / 20.0);
    let (coarse, fine) = (levels(target).ceil() as u8 + 1, levels(target).floor() as u8);
    let about = |setting: &str| json!({ "of": "frames", "setting": setting });
    give(&dive, "my-coder@a", "frames", &about("quality | 1"), 100);
    give(&dive, "my-coder@b", "frames", &about("quality 2"), 400);
    give(&dive, "residual.v2", "differences", &json!({ "of": "differences" }), 50);
    worsen(&dive, "my-coder@a", coarse);
    worsen(&dive, "my-coder@b", fine);
    std::fs::create_dir(dive.path("learned/notes")).unwrap();
    dive.run_with(&format!("{run} --learned learned"), &path).ends_with(0);
    let report = dive.json("out/paper.json");
    assert_eq!(row(&report, "my-coder@a")["setting"], "quality   1", "no cell ends there");
    assert_eq!(number(row(&report, "my-coder@b"), "bytes"), 410.0);
    assert_eq!(row(&report, "residual.v2")["setting"], "not stated");
    assert_eq!(number(row(&report, "residual.v2"), "bytes"), 88.0, "the pose is sent, too");
    assert!(row(&report, "mlic++")["missing"].is_string());
    let equal = dive.json("out/paper-equal.json");
    let between = row(&equal, "my-coder");
    let [low, high] = ["a", "b"].map(|at| number(row(&report, &format!("my-coder@{at}")), "psnr"));
    let part = (target - low) / (high - low);
    assert!((0.0..1.0).contains(&part), "{low} {target} {high}");
    let due = 110f64.powf(1.0 - part) * 410f64.powf(part);
    assert!((number(between, "bytes") / due - 1.0).abs() < 1e-9, "{between}: {due}");
    assert_eq!((&between["reached"], number(between, "psnr")), (&json!(true), target));
    assert_eq!(row(&equal, "residual.v2")["reached"], false, "it has one point, above");
    let text = String::from_utf8(dive.bytes("out/paper.md")).unwrap();
    let line = text.lines().find(|line| line.contains("`my-coder@b`")).unwrap();
    assert!(line.ends_with("| – | – |"), "the paper has no such row: {line}");
}

#[test]
fn what_others_give_is_checked_before_work_begins() {
    let dive = Dive::new();
    dive.run(&format!("{RUN} --learned none --report out")).ends_with(1).says("none: ");
    std::fs::create_dir(dive.path("learned")).unwrap();
    let learned = format!("{RUN} --learned learned --report out");
    dive.run(&learned).ends_with(1).says("learned: no folder of a coder in it");
    let exchange = dive.path("out/exchange/frames");
    std::fs::create_dir_all(&exchange).unwrap();
    for t in 0..FRAMES {
        let from = dive.path(&format!("images/{t}.png"));
        std::fs::copy(from, exchange.join(format!("{t}.png"))).unwrap();
    }
    let folder = "learned/mlic++";
    let fresh = || learn(&dive, "mlic++", "mlic++", "frames", 0.05);
    let csv = format!("{folder}/frames.csv");
    let write = |name: &str, text: &str| std::fs::write(dive.path(name), text).unwrap();
    fresh();
    std::fs::remove_file(dive.path(&csv)).unwrap();
    dive.run(&learned).ends_with(1).says("frames.csv: ");
    for (text, says) in [
        ("name,bytes\n0,1\n", "frames.csv: the header must be name,bytes,encode_ms,decode_ms"),
        ("name,bytes,encode_ms,decode_ms\n0,x,1,1\n", "frames.csv: row 1: bytes"),
        ("name,bytes,encode_ms,decode_ms\n0,1,-1,1\n", "frames.csv: row 1: encode_ms"),
        ("name,bytes,encode_ms,decode_ms\n0,1,1,1\n0,1,1,1\n", "frames.csv: row 2: \"0\""),
        ("name,bytes,encode_ms,decode_ms\n0,1,1,1\n", "frames.csv: no row of frame \"1\""),
        ("name,bytes,encode_ms,decode_ms\n0,1\n", "frames.csv: "),
    ] {
        write(&csv, text);
        dive.run(&learned).ends_with(1).says(says);
    }
    let about = format!("{folder}/method.json");
    for (text, says) in [
        ("{", "method.json: "),
        (r#"{"method": "webp"}"#, "method.json: \"method\" must be \"mlic++\""),
        (r#"{"method": "mlic++", "of": "differences"}"#, "method.json: \"of\" must be \"frames\""),
        (r#"{"of": "both"}"#, "method.json: \"of\" must be \"frames\" or"),
        (r#"{"of": "frames", "setting": 7}"#, "method.json: \"setting\""),
        (r#"{"of": "frames", "parameters": -7}"#, "method.json: \"parameters\""),
        (r#"{"method": "mlic++", "of": "frames", "lambda": 0}"#, "method.json: \"lambda\""),
    ] {
        fresh();
        write(&about, text);
        dive.run(&learned).ends_with(1).says(says);
    }
    fresh();
    let picture = dive.path(&format!("{folder}/pictures/1.png"));
    save(&nvsprior::Picture::new(320, 180), &picture);
    dive.run(&learned).ends_with(1).says("pictures/1.png: 320×180, but a picture of 160×90");
    std::fs::remove_file(&picture).unwrap();
    dive.run(&learned).ends_with(1).says("pictures/1.png: ");
    fresh();
    let mut at = dive.path(folder);
    for (name, says) in [
        ("webp", "learned/webp: `webp` is a row of the program's own"),
        ("x264", "`x264` is a row of the program's own"),
        ("ours-intra@2", "`ours-intra` is a row of the program's own"),
        ("a|b", "learned/a|b: the name of a row has at most 64 letters"),
        ("-x", "the name of a row"),
    ] {
        let next = dive.path(&format!("learned/{name}"));
        std::fs::rename(&at, &next).unwrap();
        dive.run(&learned).ends_with(1).says(says);
        at = next;
    }

    let run = format!("{RUN} --starts starts.csv --report out");
    for (text, says) in [
        (starts() + "ghost,1,0,0,0,0,0,0\n", "starts.csv: \"ghost\" is no frame of the run"),
        (starts().replace("\n1,", "\n9,"), "starts.csv: \"9\" is no frame of the run"),
        (starts().replacen("name", "file", 1), "starts.csv: column \"name\" is missing"),
        (starts().lines().take(3).collect::<Vec<_>>().join("\n"), "no start of frame \"2\""),
    ] {
        write("starts.csv", &text);
        dive.run(&run).ends_with(1).says(says);
    }
}

#[test]
fn wrong_figures_are_refused() {
    let dive = Dive::new();
    dive.run(&format!("{RUN} --frames 0")).ends_with(2);
    dive.run(&format!("{RUN} --starts gone.csv --report out")).ends_with(1).says("gone.csv: ");
}
