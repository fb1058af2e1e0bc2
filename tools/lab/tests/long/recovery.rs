//! `nvsprior-lab recovery`.

use std::collections::HashMap;

use serde_json::Value;

use crate::dive::{Dive, FRAMES, INPUT};
use crate::scene::{wall, write_prior};

const SMALL: &str = "--trials 2 --places 1 --dropouts 1 \
                     --foreign other.ply --width 80 --report out";

const COLUMNS: &str = "measurement,column,trial,detail,frame,phase,file,best_psnr,clean_psnr,\
                       db_short,found,wrong,certain,false_certain,no_start,start,lost_frames,\
                       renders,full_renders,milliseconds,in_forward_renders,pose_error_units,\
                       pose_error_degrees";

const CAPTURE: [&str; 7] =
    ["10 degrees", "20 degrees", "30 degrees", "40 degrees", "0.5 units", "1 units", "1.58 units"];

const NOTHING: [&str; 10] = [
    "plain",
    "dark",
    "low contrast",
    "rolled",
    "rolled + dark",
    "rolled + low contrast",
    "blur",
    "marine snow",
    "vignette",
    "object",
];

/// A row of the table by the names of its columns.
type Row = HashMap<String, String>;

fn rows(dive: &Dive) -> Vec<Row> {
    let text = String::from_utf8(dive.bytes("out/recovery.csv")).unwrap();
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some(COLUMNS));
    let names = || COLUMNS.split(',').map(str::to_owned);
    lines.map(|line| names().zip(line.split(',').map(str::to_owned)).collect()).collect()
}

/// What holds of every row.
fn check(row: &Row) {
    let number = |name: &str| row[name].parse::<f64>().ok();
    let is = |name: &str| row[name] == "true";
    assert!(number("milliseconds") > Some(0.0) && number("in_forward_renders") > Some(0.0));
    assert_eq!(is("false_certain"), is("certain") && is("wrong"), "{row:?}");
    assert!(!(is("found") && is("wrong")), "{row:?}");
    if is("no_start") {
        assert!(row["clean_psnr"].is_empty() && !is("certain") && !is("found"), "{row:?}");
        return;
    }
    assert_eq!(is("certain"), row["lost_frames"] == "0", "{row:?}");
    assert!(number("renders") >= number("full_renders"), "{row:?}");
    if row["measurement"] == "foreign" {
        assert!(row["db_short"].is_empty() && is("wrong"), "{row:?}");
        return;
    }
    let short = number("db_short").unwrap();
    let difference = number("best_psnr").unwrap() - number("clean_psnr").unwrap();
    assert!((difference - short).abs() < 2e-4, "{row:?}");
    assert_eq!((is("found"), is("wrong")), (short <= 0.1, short > 1.0), "{row:?}");
}

fn count(rows: &[&Row], name: &str) -> u64 {
    rows.iter().filter(|row| row[name] == "true").count() as u64
}

/// The counts of a column are those of its rows.
fn sums(rows: &[Row], measurement: &str, column: &Value) {
    let name = column["column"].as_str().unwrap();
    let of = |row: &&Row| row["measurement"] == measurement && row["column"] == name;
    let of: Vec<&Row> = rows.iter().filter(of).collect();
    let at = |figure: &str| column[figure].as_u64().unwrap_or_else(|| panic!("{figure}: {column}"));
    assert_eq!(at("frames"), of.len() as u64, "{column}");
    assert_eq!(at("trials"), of.iter().filter(|row| row["frame"] == "0").count() as u64);
    assert_eq!(at("false_certain_frames"), count(&of, "false_certain"), "{column}");
    assert_eq!(at("no_start_frames"), count(&of, "no_start"), "{column}");
    assert!(at("found_first") <= at("found") && at("found") <= at("trials"), "{column}");
    assert!(at("certain_first") <= at("certain") && at("certain") <= at("trials"), "{column}");
    if measurement == "nothing" || measurement == "capture" {
        // The first frame found is the last one.
        assert_eq!(at("found"), count(&of, "found"), "{column}");
        let first: Vec<&Row> = of.iter().filter(|row| row["frame"] == "0").copied().collect();
        assert_eq!(at("found_first"), count(&first, "found"), "{column}");
    }
}

#[test]
fn recovery_writes_every_frame_summary_and_plot() {
    let dive = Dive::new();
    write_prior(&dive.path("other.ply"), &wall(2));
    let run = dive.run(&format!("recovery {INPUT} {SMALL}")).ends_with(0);
    let rows = rows(&dive);
    rows.iter().for_each(check);
    let summary = dive.json("out/recovery.json");
    let names = |measurement: &str| -> Vec<String> {
        let columns = summary[measurement].as_array().unwrap();
        columns.iter().for_each(|column| sums(&rows, measurement, column));
        columns.iter().map(|column| column["column"].as_str().unwrap().to_owned()).collect()
    };
    assert_eq!(names("capture"), CAPTURE);
    assert_eq!(names("nothing"), NOTHING);
    // Two kinds at two rates, with and without hints.
    assert_eq!(names("dropouts").len(), 8);
    assert_eq!(names("foreign"), ["from nothing", "with hints"]);
    for column in summary["nothing"].as_array().unwrap() {
        let rolled = column["column"].as_str().unwrap().starts_with("rolled");
        assert_eq!(column["trials"], if rolled { 2 } else { FRAMES }, "{column}");
    }
    let row = |name: &str| run.stdout.contains(&format!("\n{name} "));
    assert!(CAPTURE.into_iter().chain(NOTHING).all(row), "{}", run.stdout);
    let svg = String::from_utf8(dive.bytes("out/recovery.svg")).unwrap();
    assert!(svg.trim_end().ends_with("</svg>"));
    assert!(NOTHING.iter().all(|name| svg.contains(name)), "{svg}");
}

#[test]
fn phases_come_in_order() {
    let dive = Dive::new();
    let flags = "--only dropouts --places 2 --dropouts 2 \
                 --width 80 --report out";
    dive.run(&format!("recovery {INPUT} {flags}")).ends_with(0);
    for run in rows(&dive).chunk_by(|_, next| next["frame"] != "0") {
        let phases: Vec<&str> = run.iter().map(|row| &*row["phase"]).collect();
        assert_eq!(phases[..6], ["good", "good", "good", "good", "dropout", "dropout"]);
        assert!((1..=30).contains(&phases[6..].len()) && phases[6..].iter().all(|p| *p == "clear"));
        // It ends with the first frame that is found and certain.
        let again: Vec<bool> =
            run[6..].iter().map(|r| r["found"] == "true" && r["certain"] == "true").collect();
        assert!(!again[..again.len() - 1].contains(&true), "{run:?}");
        assert!(again.len() == 30 || again.ends_with(&[true]), "{run:?}");
    }
    let summary = dive.json("out/recovery.json");
    assert_eq!(summary["capture"], Value::Array(Vec::new()));
}

#[test]
fn recovery_flags_are_checked_first() {
    let dive = Dive::new();
    for (flags, says) in [
        ("--trials 0", "--trials"),
        ("--dropouts 1,0", "--dropouts"),
        ("--rate 0", "must be above 0"),
        ("--only night", "capture, nothing, dropouts, foreign"),
        ("--only capture,foreign", "--foreign"),
    ] {
        dive.run(&format!("recovery {INPUT} {flags}")).ends_with(2).says(says);
    }
    let mut cameras = dive.json("cameras.json");
    for image in cameras["images"].as_array_mut().unwrap() {
        image.as_object_mut().unwrap().remove("qvec");
    }
    dive.write_json("cameras.json", &cameras);
    dive.run(&format!("recovery {INPUT}")).ends_with(1).says("images/0.png: its pose");
}
