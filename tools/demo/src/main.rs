//! The demo, as a program of its own: with little to compile, a newcomer sees pictures soon. `nvsprior demo` does the
//! same, and draws more.

use std::num::NonZeroUsize;
use std::path::Path;
use std::process::ExitCode;

use anyhow::Context;
use lexopt::ValueExt;
use nvsprior::Engine;
use nvsprior::vulkan::DeviceOptions;
use nvsprior_basin::{CAMERA, Dive, Run};
use nvsprior_demo::{Job, run, topside};

const USAGE: &str =
    "usage: nvsprior-demo [--out DIR] [--frames N] [--bfgs-frames N] [--device NAME]
  --out          folder for runs, prior, packets, pictures and the table (demo-out)
  --frames       frames of each inspection run (5)
  --bfgs-frames  how many of them are searched by the paper's BFGS, too: seconds for each (1)
  --device       the Vulkan device: a part of its name";

fn main() -> ExitCode {
    match work() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("nvsprior-demo: {error:#}");
            ExitCode::from(if error.is::<lexopt::Error>() { 2 } else { 1 })
        }
    }
}

fn work() -> anyhow::Result<()> {
    let mut job = Job {
        out: "demo-out".into(),
        camera: CAMERA,
        dives: vec![Dive::of(Run::T1), Dive::of(Run::T2)],
        frames: 5,
        bfgs_frames: 1,
        quality: 20.0,
    };
    let mut options = DeviceOptions::default();
    let mut arguments = lexopt::Parser::from_env();
    while let Some(argument) = arguments.next()? {
        match argument {
            lexopt::Arg::Long("out") => job.out = arguments.value()?.into(),
            lexopt::Arg::Long("frames") => {
                job.frames = arguments.value()?.parse::<NonZeroUsize>()?.get()
            }
            lexopt::Arg::Long("bfgs-frames") => job.bfgs_frames = arguments.value()?.parse()?,
            lexopt::Arg::Long("device") => options.device = Some(arguments.value()?.string()?),
            lexopt::Arg::Long("help") => {
                println!("{USAGE}");
                return Ok(());
            }
            lexopt::Arg::Value(word) if word == topside::TOPSIDE => {
                return topside::serve(Path::new(&arguments.value()?));
            }
            other => return Err(other.unexpected()).context(USAGE),
        }
    }
    let engine = Engine::new(&options)?;
    eprintln!("device: {}", engine.device());
    run(&job, &engine)
}
