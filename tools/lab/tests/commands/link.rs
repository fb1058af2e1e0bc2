//! `nvsprior-lab link`: what only comparisons ask of a link.

use crate::dive::{Dive, INPUT};

const LINK: &str =
    "link --prior prior.ply --cameras cameras.json --threshold 1e-2 --fps 10 --bit-rate 16000";

#[test]
fn a_return_channel_brings_back_what_a_blackout_took() {
    let dive = Dive::new();
    let run = format!("{LINK} --seconds 4 --blackout 0.6 --latency 3");
    dive.run(&format!("{run} --report without")).ends_with(0);
    dive.run(&format!("{run} --report with --return-delay 0.3 --half-duplex --reorder 0.1"))
        .ends_with(0);
    let shown = |folder: &str, way: &str| {
        dive.json(&format!("{folder}/link.json"))["shown"][way].as_u64().unwrap()
    };
    assert!(shown("without", "between") >= 3, "{}", shown("without", "between"));
    assert!(shown("with", "own") > shown("without", "own"));
    assert!(dive.json("with/link.json")["bytes"]["resent"].as_u64().unwrap() > 0);
}

#[test]
fn what_the_prior_does_not_show_is_told_apart() {
    let dive = Dive::without_frames();
    std::fs::write(dive.path("prior.nvsg"), nvsprior_basin::PRIOR).unwrap();
    dive.run("draw --run T2 --frames 6 --out .").ends_with(0);
    let link =
        "link --prior prior.nvsg --cameras T2/cameras.json --fps 3 --bit-rate 20000 --region";
    dive.run(&format!("{link} --report link")).ends_with(0);
    let link = dive.json("link/link.json");
    // The region is known, and small.
    assert!((0.01..0.3).contains(&link["region_part"].as_f64().unwrap()));
    assert!(link["region_psnr"].as_f64() < link["outside_psnr"].as_f64());
}

#[test]
fn the_size_changes_in_flight() {
    let dive = Dive::new();
    let width = dive.json("cameras.json")["width"].as_u64().unwrap() as u32;
    let half = width / 2;
    let link =
        format!("link {INPUT} --bit-rate 20000 --fps 10 --seconds 1 --loss 0,0.2 --report link");
    let sizes = format!("--width-from 7:{width},4:{half} --pictures shown");
    dive.run(&format!("{link} {sizes}")).ends_with(0);
    let shown = |frame: u32| {
        let picture = image::open(dive.path(&format!("shown/{frame:04}.png"))).unwrap();
        picture.width()
    };
    let widths: Vec<u32> = (0..10).map(shown).collect();
    // Frames that are left out show the picture before, of the size that it has.
    assert_eq!((widths[0], widths[6], widths[9]), (width, half, width), "{widths:?}");
    let report = dive.json("link/link.json");
    assert!(report["shown_psnr"].as_f64().unwrap() > 20.0, "{report}");
    dive.run(&format!("{link} --width-from 4:{}", 2 * width)).ends_with(2).says("--width-from");
    dive.run(&format!("{link} --width-from four:20")).ends_with(2).says("--width-from");
    dive.run(&format!("{link} --half-duplex")).ends_with(2).says("--return-delay");
}
