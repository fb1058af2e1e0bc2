//! Priors that are made of others.

use nvsprior::Prior;
use nvsprior::filter_weights::FilterWeights;
use nvsprior::prior::{Extras, extras_file};

use crate::dive::Dive;
use crate::study::row;

fn open(dive: &Dive, name: &str) -> Prior {
    Prior::open(&dive.path(name), &Default::default()).unwrap()
}

/// Puts extras beside `prior.ply`.
fn put(dive: &Dive, extras: Extras) {
    let prior = open(dive, "prior.ply");
    let beside = extras_file::to_bytes(&extras, prior.id(), prior.len());
    std::fs::write(dive.path("prior.ply.nvsx"), beside).unwrap();
}

#[test]
fn a_prior_that_is_made_of_another_has_its_filter() {
    let dive = Dive::new();
    let filter_weights = Some(FilterWeights::zero().into());
    let doubt = Some(vec![9; open(&dive, "prior.ply").len()]);
    put(&dive, Extras { filter_weights, doubt, ..Extras::default() });
    let commands = [
        ("prior trim prior.ply --cameras cameras.json --steps 1", "small.nvsg", false),
        ("prior blocks prior.ply", "parts.nvsb", true),
        ("key-frames prior.ply --cover 9", "copy.nvsg", true),
        ("import prior.ply", "own.nvsg", true),
    ];
    for (command, out, doubt) in commands {
        dive.run(&format!("{command} --out {out}")).ends_with(0);
        let prior = open(&dive, out);
        assert!(prior.filter_weights().is_some(), "{command}");
        assert_eq!(prior.extras().doubt.is_some(), doubt, "{command}");
    }
    assert_eq!(open(&dive, "own.nvsg").id(), open(&dive, "prior.ply").id());
    // Parts of which only one has them.
    std::fs::copy(dive.path("prior.ply"), dive.path("other.ply")).unwrap();
    dive.run("prior blocks prior.ply other.ply --out both.nvsb").ends_with(0);
    let both = open(&dive, "both.nvsb");
    assert!(both.filter_weights().is_none() && both.extras().doubt.is_none());
}

#[test]
fn work_that_fails_leaves_an_earlier_prior_as_it_was() {
    let dive = Dive::new();
    for (command, out) in [
        ("prior trim prior.ply --cameras nowhere.json", "earlier.ply"),
        ("prior blocks nowhere.ply", "earlier.nvsb"),
        ("import cameras.json", "earlier.nvsg"),
    ] {
        std::fs::write(dive.path(out), "an earlier prior").unwrap();
        dive.run(&format!("{command} --out {out}")).ends_with(1);
        assert_eq!(dive.bytes(out), b"an earlier prior", "{command}");
    }
}

#[test]
fn no_prior_is_written_over_what_it_is_made_of() {
    let dive = Dive::new();
    dive.run("import prior.ply --out own.nvsg").ends_with(0);
    let before = dive.bytes("own.nvsg");
    for command in [
        "prior trim own.nvsg --cameras cameras.json",
        "prior tables --prior own.nvsg --cameras cameras.json",
    ] {
        let refused = dive.run(&format!("{command} --out ./own.nvsg")).ends_with(1);
        refused.says("give it another name");
    }
    dive.run("import own.nvsg --out again.nvsg").ends_with(1).says("no foreign prior");
    dive.run("prior blocks prior.ply --out site.nvsb").ends_with(0);
    dive.run("prior blocks site.nvsb --out site.nvsb").ends_with(1).says("give it another name");
    assert_eq!(dive.bytes("own.nvsg"), before);
}

#[test]
fn a_record_of_dives_goes_with_its_prior() {
    let dive = Dive::new();
    let record = "dive,pictures,splats\nnorth,12,340\n";
    put(&dive, Extras { record: Some(record.into()), ..Extras::default() });
    let text = dive.run("inspect prior.ply").ends_with(0).stdout;
    assert_eq!(row(&text, "dive north"), "trained on 12 pictures, 340 splats more");
    // Copies have it, too, and what is left of a prior.
    for (command, out) in [
        ("key-frames prior.ply --cover 9", "copy.nvsg"),
        ("prior trim prior.ply --cameras cameras.json --steps 1", "small.nvsg"),
    ] {
        dive.run(&format!("{command} --out {out}")).ends_with(0);
        assert_eq!(open(&dive, out).extras().record.as_deref(), Some(record), "{command}");
    }
    put(&dive, Extras { record: Some("dive".into()), ..Extras::default() });
    dive.run("inspect prior.ply").ends_with(1).says("the prior's record: the first line");
}
