//! `nvsprior tables`, and what the other commands make of coder tables.

use nvsprior::Prior;
use nvsprior::coder_tables::Tables;
use nvsprior::prior::compact::{self, Quantisation};
use nvsprior::prior::{KeyFrames, PartSource, tables_file};

use crate::dive::{Dive, FRAMES, INPUT};
use crate::scene::wall;
use crate::study::row;

const TABLES: &str = "tables --cameras cameras.json --rounds 1 --prior";

fn open(dive: &Dive, name: &str) -> Prior {
    Prior::open(&dive.path(name), &Default::default()).unwrap()
}

/// A compact prior of the wall, `small.nvsg`.
fn write_compact(dive: &Dive) {
    let (wall, mut bytes) = (wall(1), Vec::new());
    let (none, q) = (KeyFrames::NONE, Quantisation::default());
    compact::write(wall.splats(), wall.options(), &none, &q, &mut bytes).unwrap();
    std::fs::write(dive.path("small.nvsg"), bytes).unwrap();
}

#[test]
fn trained_beside_the_prior_and_needed_on_both_sides() {
    let dive = Dive::new();
    std::fs::copy(dive.path("prior.ply"), dive.path("plain.ply")).unwrap();
    let id = open(&dive, "plain.ply").id();
    let text = dive.run("inspect plain.ply").ends_with(0).stdout;
    assert_eq!(row(&text, "coder tables"), "the library's own, for any scene");
    let text = dive.run(&format!("{TABLES} prior.ply")).ends_with(0).stdout;
    assert_eq!(row(&text, "frames"), "4, 4 certain: 3 learned from, 1 held out");
    assert!(row(&text, "step 32").contains(" bytes per frame, "), "{text}");
    let size = Tables::encoded_len();
    assert_eq!(row(&text, "written"), format!("prior.ply.tables, {size} bytes"));
    let prior = open(&dive, "prior.ply");
    assert_eq!(row(&text, "identity"), prior.id().to_string());
    assert!(prior.id() != id && prior.report().coder_tables == PartSource::Beside);
    assert_ne!(prior.coder_tables().map(|t| &**t), Some(&Tables::generic()));
    let text = dive.run("inspect prior.ply").ends_with(0).stdout;
    let expected = format!("the scene's own, in the file beside it: {size} bytes");
    assert_eq!(row(&text, "coder tables"), expected);
    // With the tables both sides show the same. Without them the packets are about another prior.
    dive.encode("--quality 40 --frames-out seen");
    dive.run("decode --prior prior.ply --packets packets --frames topside").ends_with(0);
    for t in 0..FRAMES {
        let [seen, topside] = ["seen", "topside"].map(|d| dive.picture(&format!("{d}/{t}.png")));
        assert_eq!(seen, topside, "frame {t}");
    }
    let refused = dive.run("decode --prior plain.ply --packets packets --frames other");
    refused.ends_with(1).says(&id.to_string());
    assert!(!dive.path("other/0.png").exists());
}

#[test]
fn the_same_frames_give_the_same_bytes_in_any_container() {
    let dive = Dive::new();
    dive.run(&format!("{TABLES} prior.ply --out a.tables")).ends_with(0);
    dive.run(&format!("{TABLES} prior.ply --out b.tables")).ends_with(0);
    assert_eq!(dive.bytes("a.tables"), dive.bytes("b.tables"));
    assert!(open(&dive, "prior.ply").coder_tables().is_none());
    write_compact(&dive);
    let text = dive.run(&format!("{TABLES} small.nvsg --out with.nvsg")).ends_with(0).stdout;
    let with = open(&dive, "with.nvsg");
    assert_eq!(row(&text, "identity"), with.id().to_string());
    assert_eq!(with.report().coder_tables, PartSource::InFile);
    // The tables in a file beside it give the same prior. A broken file there is replaced.
    std::fs::write(dive.path("small.nvsg.tables"), "broken").unwrap();
    dive.run("inspect small.nvsg").ends_with(1).says("small.nvsg.tables: coder tables, byte 0");
    dive.run(&format!("{TABLES} small.nvsg")).ends_with(0);
    assert_eq!(open(&dive, "small.nvsg").id(), with.id());
}

#[test]
fn other_commands_carry_them_over() {
    let dive = Dive::new();
    let tables = Tables::zero();
    tables_file::save(&tables, &dive.path("prior.ply.tables")).unwrap();
    let id = open(&dive, "prior.ply").id();
    let command = "key-frames prior.ply --cameras cameras.json --cover 0";
    for out in ["", "--out with.ply"] {
        let text = dive.run(&format!("{command} {out}")).ends_with(0).stdout;
        assert_eq!(row(&text, "identity"), format!("{id}, as it was"));
    }
    assert_eq!(open(&dive, "with.ply").id(), id);
    for (name, source) in [("small.ply", PartSource::Beside), ("small.nvsg", PartSource::InFile)] {
        let trim = "trim prior.ply --cameras cameras.json --steps 1 --share 0.3 --out";
        dive.run(&format!("{trim} {name}")).ends_with(0);
        let small = open(&dive, name);
        assert_eq!(small.coder_tables().map(|t| &**t), Some(&tables), "{name}");
        assert_eq!(small.report().coder_tables, source);
    }
    // A copy that would be read with another prior's tables.
    std::fs::rename(dive.path("prior.ply.tables"), dive.path("copy.ply.tables")).unwrap();
    let refused = dive.run(&format!("{command} --out copy.ply"));
    refused.ends_with(1).says("copy.ply.tables would make the copy another prior");
}

#[test]
fn refusals_name_what_is_wrong() {
    let dive = Dive::new();
    write_compact(&dive);
    std::fs::write(dive.path("taken.nvsg.tables"), "").unwrap();
    // One frame is too few: one is held out.
    let mut one = dive.json("cameras.json");
    one["images"].as_array_mut().unwrap().truncate(1);
    dive.write_json("one.json", &one);
    let few = "tables --cameras one.json --prior prior.ply";
    for (args, code, named) in [
        ("tables --prior prior.ply", 2, "--cameras"),
        ("tables --cameras cameras.json", 2, "--prior"),
        (&format!("{TABLES} prior.ply --rounds 0"), 2, "--rounds"),
        (&format!("{TABLES} prior.ply --split night"), 1, "\"night\"; there are: dive, survey"),
        (&format!("{TABLES} prior.ply --out a.ply"), 1, "a.ply: ends in .tables or .nvsg"),
        (&format!("{TABLES} prior.ply --out a.nvsg"), 1, "a.nvsg: the prior is no .nvsg but PLY"),
        (&format!("{TABLES} small.nvsg --out taken.nvsg"), 1, "taken.nvsg.tables takes precedence"),
        (&format!("{TABLES} none.ply"), 1, "none.ply"),
        (&format!("{TABLES} cameras.json"), 1, "cameras.json: neither a PLY"),
        (few, 1, "one.json: 1 of 1 frames have a certain pose, two are needed"),
    ] {
        dive.run(args).ends_with(code).says(named);
        assert!(!dive.path("prior.ply.tables").exists(), "{args}");
    }
    dive.run(&format!("encode {INPUT} --packets packets")).ends_with(0);
}
