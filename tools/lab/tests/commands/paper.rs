//! `nvsprior-lab paper`: the paper's search and coders, as commands.

use serde_json::Value;

use crate::dive::{Dive, FRAMES, INPUT, name, pictures};
use crate::scene::pose;

fn frames(summary: &Value) -> &[Value] {
    summary["frames"].as_array().unwrap()
}

/// Encodes the dive to `packets`; the summary.
fn encode(dive: &Dive, args: &str) -> Value {
    let fixed = "--packets packets --overwrite --summary summary.json";
    dive.run(&format!("paper encode {INPUT} {fixed} {args}")).ends_with(0);
    dive.json("summary.json")
}

#[test]
fn a_dive_is_encoded_and_decoded_by_two_processes() {
    let dive = Dive::new();
    let offset = "--start-offset 0.05,-0.04,0.06,1.1,-1.7,1.1";
    let summary = encode(&dive, &format!("{offset} --threshold 1 --quality 10 --pictures seen"));
    dive.run("paper decode --prior prior.ply --packets packets --overwrite --pictures topside")
        .ends_with(0);
    for (t, row) in frames(&summary).iter().enumerate() {
        assert_eq!(row["bytes"], dive.bytes(&format!("packets/{t}.paper")).len());
        assert!(row["full_renders"].as_f64() > Some(3.0), "a gradient method: {row}");
        let decoded = dive.picture(&format!("topside/{t}.png"));
        assert_eq!(decoded, dive.picture(&format!("seen/{t}.png")), "frame {t}");
        let psnr = decoded.psnr(&pictures()[t]);
        assert!((psnr - row["psnr"].as_f64().unwrap()).abs() < 1e-9, "frame {t}: {psnr} dB");
        assert!(psnr > 28.0, "frame {t}: {psnr} dB");
    }
}

#[test]
fn the_papers_pose_has_seven_floats() {
    let dive = Dive::new();
    let summary = encode(&dive, "--residual none --optimizer gauss-newton");
    // With the kind of the packet and its check.
    assert_eq!(summary["mean"]["latent_bytes"], 7.0 * 4.0 + 5.0);
}

#[test]
fn wrong_usage_ends_with_2() {
    let dive = Dive::without_frames();
    let encode = format!("paper encode {INPUT} --packets p --overwrite");
    for (args, named) in [
        ("--start-offset 1,2,3", "6 numbers are due, but 3 were given"),
        ("--start-offset 1,2,3,4,5,nan", "finite"),
        ("--optimizer newton", "gauss-newton"),
    ] {
        dive.run(&format!("{encode} {args}")).ends_with(2).says(named);
    }
}

/// The kinds of starts if no frame is near enough to the one before for the paper's optimiser.
fn starts(dive: &Dive, args: &str) -> Vec<Value> {
    let summary = encode(dive, &format!("--residual none --threshold 0 {args}"));
    frames(&summary).iter().map(|row| row["start"].clone()).collect()
}

#[test]
fn poses_from_outside_come_from_the_camera_file_or_from_a_csv_file() {
    let dive = Dive::new();
    assert_eq!(starts(&dive, ""), ["external", "uncertain", "uncertain"]);
    assert_eq!(starts(&dive, "--starts camera-file"), ["external"; FRAMES]);
    let header = "file,qw,qx,qy,qz,tx,ty,tz\n";
    let rows = [0, 2].map(|t| row(t) + "\n").concat();
    std::fs::write(dive.path("poses.csv"), format!("{header}{rows}")).unwrap();
    assert_eq!(starts(&dive, "--starts poses.csv"), ["external", "uncertain", "external"]);
}

/// A row of poses.csv.
fn row(t: usize) -> String {
    let pose = pose(t as f64);
    let ([w, x, y, z], p) = (pose.wxyz(), pose.translation);
    format!("{},{w},{x},{y},{z},{},{},{}", name(t), p.x, p.y, p.z)
}
