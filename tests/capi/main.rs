//! The C library, tested with the programs in `tests/c`: each is one test here. `scripts/c-test.sh` runs them against
//! the installed library, and under memory checkers.

#[path = "../common/mod.rs"]
mod common;
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

macro_rules! programs {
    ($($name:ident: $arguments:expr;)*) => {
        $(#[test]
        fn $name() {
            programs::run(stringify!($name), &$arguments);
        })*
    };
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
    truth: [];
    blocks: [];
    held_memory: [];
    threads: [];
    given_device: [];
    dmabuf: [];
    unprotected: [];
    garbage: [];
    allocations: [];
    soak: ["200"];
    float_environment: [];
    small_stack: [];
}

/// `make c-test` sends 10,500 packets; this, 400.
#[test]
fn shares() {
    programs::run_few("shares");
}

/// `make c-test` fails each allocation once; this, some.
#[test]
fn no_memory() {
    programs::run_few("no_memory");
}

/// The figures mean something for an optimised library only; that frames take no memory holds for this one, too.
#[test]
fn figures() {
    programs::run_few("figures");
}

#[test]
fn lost_device() {
    programs::run_with_layer("lost_device", "lost_device_layer");
}

#[test]
fn hung_device() {
    programs::run_with_layer("hung_device", "lost_device_layer");
}
