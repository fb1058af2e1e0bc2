//! What a GPU's compiler makes of the engine's pipelines: `make gpu-check`.

use std::process::ExitCode;

use clap::Parser as _;
use nvsprior_lab::gpu_check::{Args, run};

fn main() -> ExitCode {
    run(&Args::parse()).unwrap_or_else(|error| {
        eprintln!("gpu-check: {error:#}");
        ExitCode::FAILURE
    })
}
