//! The laboratory's commands, which take long: `make long-test`.

mod ablation;
mod bench;
mod codecs;
#[path = "../../../../tests/common/mod.rs"]
mod common;
mod device_report;
#[allow(dead_code)] // The tests of the command line use the rest.
#[path = "../../../cli/tests/cli/dive.rs"]
mod dive;
mod paper;
mod recovery;
#[path = "../../../../tests/scene/mod.rs"]
mod scene;
mod stability;
#[allow(dead_code)]
#[path = "../../../cli/tests/cli/treated.rs"]
mod treated;
