//! What takes long: training and lists at length. `make long-test`.

#[path = "../../../../tests/common/mod.rs"]
mod common;
#[allow(dead_code)] // The tests of the command line use the rest.
#[path = "../cli/dive.rs"]
mod dive;
mod map;
mod map_hard;
mod map_parts;
#[cfg(unix)]
mod map_structure;
mod preprocessing;
#[path = "../../../../tests/scene/mod.rs"]
mod scene;
#[allow(dead_code)]
#[path = "../cli/treated.rs"]
mod treated;
