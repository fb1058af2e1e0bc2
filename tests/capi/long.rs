//! The programs of `tests/c` that take long: `make long-test`.

#[path = "../common/mod.rs"]
mod common;
#[macro_use]
mod programs;
mod scene;
#[path = "../scene/mod.rs"]
mod wall;

programs! {
    truth: [];
    blocks: [];
    held_memory: [];
    threads: [];
    garbage: [];
    allocations: [];
    soak: ["200"];
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
