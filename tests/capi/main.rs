//! The C library, tested with the programs in `tests/c`: each is one test here. Those that take long are in `long.rs`.
//! `scripts/c-test.sh` runs all of them against the installed library, and under memory checkers.

#[path = "../common/mod.rs"]
mod common;
#[macro_use]
mod programs;
mod scene;
#[path = "../scene/mod.rs"]
mod wall;

/// `scripts/c-test.sh` gets the files by this, too.
#[test]
fn scene_is_written() {
    let folder = scene::folder();
    let prior = nvsprior::Prior::open(&folder.join("prior.ply"), &Default::default()).unwrap();
    let other = nvsprior::Prior::open(&folder.join("other.ply"), &Default::default()).unwrap();
    assert_eq!(prior.id(), wall::wall(1).id());
    assert_ne!(prior.id(), other.id());
}

programs! {
    structs: [];
    nulls: [];
    keys: [];
    images: [];
    encoding: [];
    lens_and_mask: [];
    pipelined: [];
    stream: [];
    decoding: [];
    given_device: [];
    dmabuf: [];
    unprotected: [];
    updates: [];
}

/// `make c-test` sends 10,500 packets; this, 400.
#[test]
fn shares() {
    programs::run_few("shares");
}
