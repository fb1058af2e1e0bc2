//! `nvsprior merge`, and what `inspect` says of an update.

use nvsprior::filter_weights::FilterWeights;
use nvsprior::prior::{Change, Learnt, NewSplat, Update, UpdateChain, UpdateGrid, filter_file};
use nvsprior::{Prior, PriorId};

use crate::dive::Dive;
use crate::scene::{wall, write_prior};
use crate::study::row;

/// A folder with `prior.ply` and the updates `a.nvsu` to `c.nvsu`, which are the third, the first and the second.
struct Merge {
    dive: Dive,
    updates: [Update; 3],
}

fn open(dive: &Dive, name: &str) -> Prior {
    Prior::open(&dive.path(name), &Default::default()).unwrap()
}

fn splats(count: i32) -> Vec<NewSplat> {
    let splat = |index: i32| NewSplat {
        position: [index % 9 * 20, index / 9 * 20, index % 4],
        log_scale: [-12, -11, -14],
        rotation: [1, -2, 3],
        opacity: 4,
        colour: [5, index as i8 % 3, -2],
    };
    (0..count).map(splat).collect()
}

/// The first update adds 40 splats and fades a part of the wall, the second takes back two and adds one, the third
/// fades the rest of that part.
fn updates(prior: PriorId) -> [Update; 3] {
    let grid = UpdateGrid { origin: [0.0, 0.0, -1.0], exponent: -7 };
    let first = Update {
        prior,
        number: 1,
        before: prior.into(),
        grid,
        splats: splats(40),
        removed: vec![],
        changed: vec![],
        fades: vec![grid.fade([-0.5, -0.5, -9.0], [0.5, 0.5, 9.0], 128)],
        frames: [10, 90],
    };
    let second = Update {
        number: 2,
        before: first.state(),
        splats: splats(1),
        removed: vec![0, 39],
        changed: vec![Change { ordinal: 1, colour: [1, 0, 0], ..Change::default() }],
        fades: vec![],
        ..first.clone()
    };
    let fades = vec![grid.fade([-0.5, -0.5, -9.0], [0.5, 0.5, 9.0], 0)];
    let before = second.state();
    let (splats, removed) = (vec![], vec![]);
    let third = Update { number: 3, before, splats, removed, fades, ..first.clone() };
    let mut first = first;
    first.splats = Update::read(&bytes(&first)).unwrap().splats;
    [first, second, third]
}

fn bytes(update: &Update) -> Vec<u8> {
    let mut bytes = Vec::new();
    update.write(&mut bytes).unwrap();
    bytes
}

impl Merge {
    fn new() -> Merge {
        let dive = Dive::without_frames();
        let updates = updates(open(&dive, "prior.ply").id());
        for (update, name) in updates.iter().zip(["b.nvsu", "c.nvsu", "a.nvsu"]) {
            update.save(&dive.path(name)).unwrap();
        }
        Merge { dive, updates }
    }
}

#[test]
fn a_chain_in_any_order_becomes_a_part_of_the_prior() {
    let Merge { dive, updates } = Merge::new();
    let prior = open(&dive, "prior.ply");
    let mut learnt = Learnt::none(prior.id());
    for update in &updates {
        learnt.add(update).unwrap();
    }
    let expected = prior.with_learnt(&learnt).unwrap();
    assert!(expected.len() < prior.len() + 39, "some of the wall is gone");
    let text = dive.run("merge prior.ply a.nvsu b.nvsu c.nvsu --out next.ply").ends_with(0).stdout;
    let merged = open(&dive, "next.ply");
    assert_eq!((merged.id(), merged.splats()), (expected.id(), expected.splats()));
    assert_eq!(row(&text, "prior"), format!("{}, {} splats", prior.id(), prior.len()));
    assert_eq!(row(&text, "updates"), format!("3, which lead to state {}", learnt.state()));
    assert_eq!(row(&text, "learnt"), "39 splats");
    let gone = prior.len() + 39 - expected.len();
    assert_eq!(row(&text, "faded"), format!("{gone} splats, {gone} of them left out"));
    assert_eq!(row(&text, "identity"), merged.id().to_string());
    // A compact one has the same splats, to a step.
    let text = dive.run("merge prior.ply b.nvsu c.nvsu a.nvsu --out next.nvsg").ends_with(0).stdout;
    let compact = open(&dive, "next.nvsg");
    assert_eq!(compact.len(), merged.len());
    assert_eq!(row(&text, "identity"), compact.id().to_string());
    assert_ne!(compact.id(), merged.id());
    // The first two alone: fainter, but there.
    dive.run("merge prior.ply c.nvsu b.nvsu --out two.ply").ends_with(0);
    assert_eq!(open(&dive, "two.ply").len(), prior.len() + 39);
}

#[test]
fn what_does_not_belong_together_is_refused_by_its_name() {
    let Merge { dive, updates } = Merge::new();
    let refused = |args: &str, says: &str| {
        dive.run(&format!("merge {args} --out next.ply")).ends_with(1).says(says);
        assert!(!dive.path("next.ply").exists());
    };
    let (first, second) = (updates[0].state(), updates[1].state());
    refused(
        "prior.ply a.nvsu b.nvsu",
        &format!(
            "a.nvsu: update 3 stands on state {second}, but update 2 is due, on state {first}; \
             add update 2 first"
        ),
    );
    let twice = Update { frames: [1, 2], ..updates[0].clone() };
    twice.save(&dive.path("twice.nvsu")).unwrap();
    refused("prior.ply b.nvsu c.nvsu twice.nvsu", "twice.nvsu: update 1 stands on state ");
    let other = Update { before: second, ..updates[1].clone() };
    other.save(&dive.path("other.nvsu")).unwrap();
    refused(
        "prior.ply b.nvsu other.nvsu",
        &format!(
            "other.nvsu: update 2 stands on state {second}, but the updates before it lead to"
        ),
    );
    write_prior(&dive.path("smaller.ply"), &wall(0));
    refused("smaller.ply b.nvsu", "b.nvsu: an update of prior ");
    std::fs::write(dive.path("b.nvsu"), &bytes(&updates[0])[..99]).unwrap();
    refused("prior.ply c.nvsu b.nvsu", "b.nvsu: damaged: ");
    refused("prior.ply prior.ply", "prior.ply: no update of a prior: ");
    refused("c.nvsu prior.ply", "c.nvsu: ");
    dive.run("merge prior.ply c.nvsu --out next.spz").ends_with(1).says("in .nvsg, .nvsb or .ply");
    dive.run("merge prior.ply --out next.ply").ends_with(2).says("<UPDATE>");
}

#[test]
fn inspect_says_what_an_update_holds() {
    let Merge { dive, updates } = Merge::new();
    let text = dive.run("inspect b.nvsu").ends_with(0).stdout;
    let size = dive.bytes("b.nvsu").len();
    assert_eq!(row(&text, "prior"), updates[0].prior.to_string());
    assert_eq!(row(&text, "number"), "1");
    assert_eq!(row(&text, "stands on"), format!("state {}", updates[0].before));
    assert_eq!(row(&text, "state"), updates[0].state().to_string());
    assert_eq!(row(&text, "frames"), "10 to 90");
    assert_eq!(row(&text, "bytes"), size.to_string());
    let each = size as f64 / 40.0;
    assert_eq!(row(&text, "splats"), format!("40 new, {each:.2} bytes each"));
    assert_eq!(row(&text, "taken back"), "0 learnt before");
    assert_eq!(
        row(&text, "fade"),
        "to 50 % from (-0.5000, -0.5000, -9.0000) to (0.5625, 0.5625, 9.0625)"
    );
    let lies = "from (0.0000, 0.0000, -1.0000) to (1.2500, 0.6250, -0.9766)";
    assert_eq!(row(&text, "where"), lies);
    let text = dive.run("inspect c.nvsu").ends_with(0).stdout;
    assert_eq!(row(&text, "taken back"), "2 learnt before");
    dive.run("inspect a.nvsu --cameras cameras.json").ends_with(1).says("not with an update");
    std::fs::write(dive.path("a.nvsu"), "nvsu").unwrap();
    dive.run("inspect a.nvsu").ends_with(1).says("a.nvsu: truncated: ");
}

/// Writes the first updates as the chain that a side keeps.
fn keep(dive: &Dive, updates: &[Update]) {
    let mut chain = UpdateChain::none(updates[0].prior);
    updates.iter().for_each(|update| chain.add(update.clone()).unwrap());
    chain.save(&dive.path("dive.nvsu")).unwrap();
}

#[test]
fn what_a_side_keeps_is_merged_as_its_updates_are() {
    let Merge { dive, updates } = Merge::new();
    dive.run("merge prior.ply a.nvsu b.nvsu c.nvsu --out next.ply").ends_with(0);
    keep(&dive, &updates);
    dive.run("merge prior.ply dive.nvsu --out kept.ply").ends_with(0);
    assert_eq!(dive.bytes("kept.ply"), dive.bytes("next.ply"));
    // A folder of a dive has both.
    dive.run("merge prior.ply a.nvsu b.nvsu c.nvsu dive.nvsu --out both.ply").ends_with(0);
    assert_eq!(dive.bytes("both.ply"), dive.bytes("next.ply"));
    // Of a half-written one what came before is taken.
    let bytes = dive.bytes("dive.nvsu");
    std::fs::write(dive.path("dive.nvsu"), &bytes[..bytes.len() - 1]).unwrap();
    let said = "dive.nvsu: update 3 and all after it are left out: truncated: ";
    dive.run("merge prior.ply dive.nvsu --out two.ply").ends_with(0).says(said);
    dive.run("merge prior.ply b.nvsu c.nvsu --out expected.ply").ends_with(0);
    assert_eq!(dive.bytes("two.ply"), dive.bytes("expected.ply"));
    let text = dive.run("inspect dive.nvsu").ends_with(0).stdout;
    assert!(row(&text, "left out").contains("update 3 and all after it are left out"), "{text}");
    // The missing one is found elsewhere.
    dive.run("merge prior.ply dive.nvsu a.nvsu --out three.ply").ends_with(0);
    assert_eq!(dive.bytes("three.ply"), dive.bytes("next.ply"));
}

#[test]
fn inspect_says_what_a_chain_holds() {
    let Merge { dive, updates } = Merge::new();
    keep(&dive, &updates);
    let text = dive.run("inspect dive.nvsu").ends_with(0).stdout;
    let bytes: Vec<usize> = updates.iter().map(|update| bytes(update).len()).collect();
    let state = updates[2].state();
    assert_eq!(row(&text, "prior"), updates[0].prior.to_string());
    assert_eq!(row(&text, "updates"), format!("3, which lead to state {state}"));
    assert_eq!(row(&text, "bytes"), format!("{} of all updates", bytes.iter().sum::<usize>()));
    assert_eq!(row(&text, "learnt"), "39 splats, 2 fades");
    assert_eq!(
        row(&text, "update 1"),
        format!(
            "frames 10 to 90, {} bytes: 40 splats new, 0 changed, 0 taken back, 1 fades; \
             from (-0.500, -0.500, -9.000) to (1.250, 0.625, 9.062)",
            bytes[0]
        )
    );
    // Where the splats lie that are changed or taken back, too.
    assert_eq!(
        row(&text, "update 2"),
        format!(
            "frames 10 to 90, {} bytes: 1 splats new, 1 changed, 2 taken back, 0 fades; \
             from (0.000, 0.000, -1.000) to (1.250, 0.469, -0.977)",
            bytes[1]
        )
    );
    dive.run("inspect dive.nvsu --cameras cameras.json").ends_with(1).says("not with an update");
}

#[test]
fn a_prior_that_is_made_of_another_has_its_filter() {
    let (Merge { dive, .. }, survey) = (Merge::new(), Dive::new());
    let weights = FilterWeights::zero();
    for folder in [&dive, &survey] {
        filter_file::save(&weights, &folder.path("prior.ply.filter")).unwrap();
    }
    let commands = [
        (&dive, "merge prior.ply b.nvsu", "next.nvsg"),
        (&survey, "trim prior.ply --cameras cameras.json --steps 1 --share 0.3", "small.ply"),
        (&dive, "blocks prior.ply", "parts.nvsb"),
        (&dive, "key-frames prior.ply --cover 9", "copy.ply"),
    ];
    for (dive, command, out) in commands {
        dive.run(&format!("{command} --out {out}")).ends_with(0);
        assert_eq!(dive.bytes(&format!("{out}.filter")), weights.write(), "{command}");
    }
    // Parts of which only one has weights.
    std::fs::copy(dive.path("prior.ply"), dive.path("other.ply")).unwrap();
    dive.run("blocks prior.ply other.ply --out both.nvsb").ends_with(0);
    assert!(!dive.path("both.nvsb.filter").exists());
    // Weights of an earlier run.
    dive.run("blocks other.ply --out parts.nvsb")
        .ends_with(0)
        .says("parts.nvsb.filter: its weights");
    std::fs::write(dive.path("parts.nvsb.filter"), "broken").unwrap();
    dive.run("blocks other.ply --out parts.nvsb").ends_with(1).says("parts.nvsb.filter");
}

#[test]
fn work_that_fails_leaves_an_earlier_prior_as_it_was() {
    let dive = Dive::new();
    filter_file::save(&FilterWeights::zero(), &dive.path("prior.ply.filter")).unwrap();
    for (command, out) in [
        ("trim prior.ply --cameras nowhere.json", "earlier.ply"),
        ("blocks prior.ply --coarseness=-1", "earlier.nvsb"),
    ] {
        std::fs::write(dive.path(out), "an earlier prior").unwrap();
        dive.run(&format!("{command} --out {out}")).ends_with(1);
        assert_eq!(dive.bytes(out), b"an earlier prior", "{command}");
        assert!(!dive.path(&format!("{out}.filter")).exists(), "{command}");
    }
}

#[test]
fn a_merged_prior_says_what_it_has_learnt_on_which_dive() {
    let Merge { dive, updates } = Merge::new();
    dive.run("merge prior.ply b.nvsu --out one.nvsg").ends_with(0);
    let text = dive.run("inspect one.nvsg").ends_with(0).stdout;
    let size = bytes(&updates[0]).len();
    assert_eq!(row(&text, "learnt"), format!("in 1 updates of {size} bytes:"));
    let first = format!("update 1: frames 10 to 90, {size} bytes: 40 splats new, ");
    assert!(row(&text, "dive 1").starts_with(&first), "{text}");
    // The next dive begins with the merged prior. Its record goes on.
    let id = open(&dive, "one.nvsg").id();
    let second = Update { prior: id, before: id.into(), frames: [3, 4], ..updates[0].clone() };
    second.save(&dive.path("second.nvsu")).unwrap();
    dive.run("merge one.nvsg second.nvsu --out two.ply --dive 2026-11-26").ends_with(0);
    let text = dive.run("inspect two.ply").ends_with(0).stdout;
    assert!(row(&text, "learnt").starts_with("in 2 updates of "), "{text}");
    assert!(row(&text, "dive 1").starts_with(&first), "{text}");
    assert!(row(&text, "dive 2026-11-26").starts_with("update 1: frames 3 to 4, "), "{text}");
    // A copy has it, too.
    dive.run("key-frames two.ply --cover 9 --out copy.ply").ends_with(0);
    assert_eq!(dive.bytes("copy.ply.learnt"), dive.bytes("two.ply.learnt"));
    // Of another prior in its place the record says nothing.
    std::fs::copy(dive.path("prior.ply"), dive.path("two.ply")).unwrap();
    let run = dive.run("inspect two.ply").ends_with(0).says("two.ply.learnt: of prior ");
    assert!(!run.stdout.contains("learnt"), "{}", run.stdout);
    std::fs::write(dive.path("two.ply.learnt"), "dive,what").unwrap();
    dive.run("inspect two.ply").ends_with(1).says("two.ply.learnt: no record");
    dive.run("merge prior.ply b.nvsu --out one.ply --dive a,b").ends_with(2).says("--dive");
}
