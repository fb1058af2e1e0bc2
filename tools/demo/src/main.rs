//! The demo, as a program of its own: with little to compile, a newcomer sees pictures soon. `nvsprior demo` does the
//! same, and draws more.

use std::path::Path;
use std::process::ExitCode;

use nvsprior::Engine;
use nvsprior::vulkan::DeviceOptions;
use nvsprior_basin::{CAMERA, Dive, Run};
use nvsprior_demo::{Job, run, topside};
use nvsprior_runs::say;

const USAGE: &str =
    "usage: nvsprior-demo [--out DIR] [--frames N] [--bfgs-frames N] [--device NAME]
  --out          folder for runs, prior, packets, pictures and the table (demo-out)
  --frames       frames of each inspection run (5)
  --bfgs-frames  how many of them are searched by the paper's BFGS, too: seconds for each (1)
  --device       the Vulkan device: a part of its name";

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let done = match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        [topside::TOPSIDE, prior] => topside::serve(Path::new(prior)),
        ["--help"] => {
            say!("{USAGE}");
            return ExitCode::SUCCESS;
        }
        _ => match wanted(&arguments) {
            Ok((job, device)) => demo(&job, device),
            Err(error) => {
                eprintln!("nvsprior-demo: {error}\n{USAGE}");
                return ExitCode::from(2);
            }
        },
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("nvsprior-demo: {error:#}");
            ExitCode::FAILURE
        }
    }
}

/// What the arguments ask for, and the device's name; or what is wrong with them.
fn wanted(arguments: &[String]) -> Result<(Job, Option<String>), String> {
    let mut job = Job {
        out: "demo-out".into(),
        camera: CAMERA,
        dives: vec![Dive::of(Run::T1), Dive::of(Run::T2)],
        frames: 5,
        bfgs_frames: 1,
        quality: 20.0,
    };
    let mut device = None;
    for pair in arguments.chunks(2) {
        let [option, value] = pair else { return Err(format!("{}: a value is missing", pair[0])) };
        let number = || value.parse::<usize>().map_err(|e| format!("{option} {value}: {e}"));
        match option.as_str() {
            "--out" => job.out = value.into(),
            "--frames" => job.frames = number()?,
            "--bfgs-frames" => job.bfgs_frames = number()?,
            "--device" => device = Some(value.clone()),
            _ => return Err(format!("no option is called {option}")),
        }
    }
    if job.frames == 0 { Err("--frames: at least 1".into()) } else { Ok((job, device)) }
}

fn demo(job: &Job, device: Option<String>) -> anyhow::Result<()> {
    let engine = Engine::new(&DeviceOptions { device, ..DeviceOptions::default() })?;
    eprintln!("device: {}", engine.device());
    run(job, &engine)
}
