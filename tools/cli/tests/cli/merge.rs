//! `nvsprior merge`, and what `inspect` says of an update.

use nvsprior::prior::{Change, Learnt, NewSplat, Update, UpdateGrid};
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
    refused("prior.ply b.nvsu c.nvsu b.nvsu", "b.nvsu: update 1 stands on state ");
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
    dive.run("merge prior.ply c.nvsu --out next.spz").ends_with(1).says("in .nvsg or .ply");
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
