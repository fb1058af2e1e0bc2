//! `nvsprior prior tables`, and what the other commands make of coder tables.

use nvsprior::Prior;
use nvsprior::coder_tables::Tables;
use nvsprior::prior::compact::{self, Quantisation};
use nvsprior::prior::with_coder_tables;

use crate::dive::{Dive, FRAMES, INPUT};
use crate::scene::wall;
use crate::study::row;

const TABLES: &str = "prior tables --cameras cameras.json --steps 1 --prior";

fn open(dive: &Dive, name: &str) -> Prior {
    Prior::open(&dive.path(name), &Default::default()).unwrap()
}

/// A compact prior of the wall, `small.nvsg`.
fn write_compact(dive: &Dive) {
    let (wall, mut bytes) = (wall(1), Vec::new());
    let q = Quantisation::default();
    compact::write(wall.splats(), &wall.besides(), &q, &mut bytes).unwrap();
    std::fs::write(dive.path("small.nvsg"), bytes).unwrap();
}

#[test]
fn trained_for_a_copy_of_the_prior_and_needed_on_both_sides() {
    let dive = Dive::new();
    let plain = open(&dive, "prior.ply");
    let text = dive.run("inspect prior.ply").ends_with(0).stdout;
    assert_eq!(row(&text, "coder tables"), "the library's own, for any scene");
    let text = dive.run(&format!("{TABLES} prior.ply --out with.nvsg")).ends_with(0).stdout;
    assert_eq!(row(&text, "frames"), "4, 4 certain: 3 learned from, 1 held out");
    assert!(row(&text, "step 32").contains(" bytes per frame, "), "{text}");
    assert!(row(&text, "written").starts_with("with.nvsg, "), "{text}");
    let prior = open(&dive, "with.nvsg");
    assert_eq!(row(&text, "identity"), prior.id().to_string());
    assert!(prior.id() != plain.id() && prior.splats() == plain.splats());
    assert_ne!(prior.coder_tables().map(|t| &**t), Some(&Tables::generic()));
    let text = dive.run("inspect with.nvsg").ends_with(0).stdout;
    let expected = format!("the scene's own, {} bytes", Tables::encoded_len());
    assert_eq!(row(&text, "coder tables"), expected);
    // With the tables both sides show the same. Without them the packets are about another prior.
    let encode =
        format!("encode {INPUT} --packets packets --overwrite --quality 40 --pictures seen");
    dive.run(&encode.replace("prior.ply", "with.nvsg")).ends_with(0);
    dive.run("decode --prior with.nvsg --packets packets --overwrite --frames topside")
        .ends_with(0);
    for t in 0..FRAMES {
        let [seen, topside] = ["seen", "topside"].map(|d| dive.picture(&format!("{d}/{t}.png")));
        assert_eq!(seen, topside, "frame {t}");
    }
    let refused = dive.run("decode --prior prior.ply --packets packets --overwrite --frames other");
    refused.ends_with(1).says(&plain.id().to_string());
    assert!(!dive.path("other/0.png").exists());
}

#[test]
fn the_same_frames_give_the_same_tables() {
    let dive = Dive::new();
    write_compact(&dive);
    dive.run("prior blocks prior.ply --out site.nvsb").ends_with(0);
    for (prior, out) in
        [("small.nvsg", "a.nvsg"), ("small.nvsg", "b.nvsg"), ("site.nvsb", "c.nvsb")]
    {
        let text = dive.run(&format!("{TABLES} {prior} --out {out}")).ends_with(0).stdout;
        let with = open(&dive, out);
        assert_eq!(row(&text, "identity"), with.id().to_string());
        assert!(with.coder_tables().is_some() && with.splats() == open(&dive, prior).splats());
    }
    assert_eq!(dive.bytes("a.nvsg"), dive.bytes("b.nvsg"));
}

#[test]
fn other_commands_carry_them_over() {
    let dive = Dive::new();
    write_compact(&dive);
    let tables = Tables::zero();
    let with = with_coder_tables(&dive.bytes("small.nvsg"), Some(&tables)).unwrap();
    std::fs::write(dive.path("with.nvsg"), with).unwrap();
    let id = open(&dive, "with.nvsg").id();
    let command = "key-frames with.nvsg --cameras cameras.json --cover 0";
    for out in ["", "--out copy.nvsg"] {
        let text = dive.run(&format!("{command} {out}")).ends_with(0).stdout;
        assert_eq!(row(&text, "identity"), format!("{id}, as it was"));
    }
    assert_eq!(open(&dive, "copy.nvsg").id(), id);
    let trim = "prior trim with.nvsg --cameras cameras.json --steps 1 --out";
    dive.run(&format!("{trim} trimmed.nvsg")).ends_with(0);
    assert_eq!(open(&dive, "trimmed.nvsg").coder_tables().map(|t| &**t), Some(&tables));
    dive.run(&format!("{trim} trimmed.ply")).ends_with(1).says("a .ply holds no coder tables");
}

#[test]
fn refusals_name_what_is_wrong() {
    let dive = Dive::new();
    write_compact(&dive);
    // One frame is too few: one is held out.
    let mut one = dive.json("cameras.json");
    one["images"].as_array_mut().unwrap().truncate(1);
    dive.write_json("one.json", &one);
    let few = "prior tables --cameras one.json --prior prior.ply --out a.nvsg";
    let out = format!("{TABLES} prior.ply --out a.nvsg");
    for (args, code, named) in [
        ("prior tables --prior prior.ply --out a.nvsg", 2, "--cameras"),
        ("prior tables --cameras cameras.json --out a.nvsg", 2, "--prior"),
        (&format!("{TABLES} prior.ply"), 2, "--out"),
        (&format!("{out} --steps 0"), 2, "--steps"),
        (&format!("{out} --split night"), 1, "\"night\"; there are: dive, survey"),
        (&format!("{TABLES} prior.ply --out a.ply"), 1, "a.ply: a copy of a PLY"),
        (&format!("{TABLES} small.nvsg --out a.nvsb"), 1, "a.nvsb: a copy of a compact prior"),
        (&format!("{TABLES} none.ply --out a.nvsg"), 1, "none.ply"),
        (&format!("{TABLES} cameras.json --out a.nvsg"), 1, "cameras.json: neither a PLY"),
        (few, 1, "one.json: 1 of 1 frames have a certain pose, two are needed"),
    ] {
        dive.run(args).ends_with(code).says(named);
        assert!(!dive.path("a.nvsg").exists(), "{args}");
    }
    dive.run(&format!("encode {INPUT} --packets packets --overwrite")).ends_with(0);
}
