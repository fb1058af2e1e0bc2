//! What takes long: the laboratory's commands, and training and lists at length. `make long-test`.

mod ablation;
mod bench;
mod codecs;
#[path = "../../../../tests/common/mod.rs"]
mod common;
mod device_report;
#[allow(dead_code)] // The tests of the command line use the rest.
#[path = "../cli/dive.rs"]
mod dive;
mod map;
mod paper;
mod preprocessing;
mod recovery;
#[path = "../../../../tests/scene/mod.rs"]
mod scene;
mod stability;
#[allow(dead_code)]
#[path = "../cli/treated.rs"]
mod treated;
