//! The laboratory's commands that take seconds. The others: `tests/long`.

#[path = "../../../../tests/common/mod.rs"]
mod common;
#[allow(dead_code)] // The tests of the command line use the rest.
#[path = "../../../cli/tests/cli/dive.rs"]
mod dive;
mod draw;
mod link;
mod paper;
#[path = "../../../../tests/scene/mod.rs"]
mod scene;
