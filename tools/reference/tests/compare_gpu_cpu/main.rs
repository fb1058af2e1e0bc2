//! Holds every GPU stage against its f64 twin on the CPU.

#[path = "../../../../tests/common/mod.rs"]
mod common;

mod agreement;
mod difference;
mod equations;
mod frame;
mod guards;
mod jacobian;
mod pictures;
mod sorting;
mod sparse;
mod stages;
mod subgroups;
