//! `nvsprior`: encodes frames against a prior, decodes packets, renders, inspects, measures.

#[macro_use]
extern crate nvsprior_inputs;

mod container;
mod decode;
mod demo;
mod devices;
mod encode;
mod hand_over;
mod import;
mod inspect;
mod join;
mod key;
mod keyed_files;
mod map;
mod mapping_run;
mod mission;
mod picture_renderer;
mod prior;
mod prior_file;
mod record;
mod render;
mod split;
mod view_set;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use nvsprior_channel::link;
#[cfg(feature = "console")]
use nvsprior_console::{channel, console, vehicle};
use nvsprior_inputs::values::WrongUsage;
use nvsprior_runs::untold;

/// Pictures through an acoustic modem: image compression against a 3D Gaussian Splatting prior.
///
/// Vehicle and topside hold the same trained scene. For each frame, `encode` finds the pose at which the scene looks
/// most like the frame. It writes the pose with a coded difference picture to a packet. `decode` renders the scene at
/// that pose and adds the difference.
///
/// Measurements are commands of `nvsprior-lab`. `bench`, `stability` and `device-report` are handed over to it.
///
/// Exit codes: 0 done, 1 something failed (named on standard error), 2 wrong usage.
#[derive(Parser)]
#[command(name = "nvsprior", version, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Encode(encode::Args),
    Decode(decode::Args),
    Split(split::Args),
    Join(join::Args),
    Key(key::Args),
    Link(link::Args),
    #[cfg(feature = "console")]
    Vehicle(vehicle::Args),
    #[cfg(feature = "console")]
    Channel(channel::Args),
    #[cfg(feature = "console")]
    Console(console::Args),
    Render(render::Args),
    Inspect(inspect::Args),
    Map(map::Args),
    Import(import::Args),
    #[command(subcommand)]
    Prior(prior::Command),
    #[command(hide = true)]
    KeyFrames(prior::key_frames::Args),
    Demo(demo::Args),
    #[command(hide = true, name = nvsprior_demo::topside::TOPSIDE)]
    DemoTopside(demo::TopsideArgs),
    Devices(devices::Args),
}

fn main() -> ExitCode {
    if let Some(handed_over) = hand_over::to_laboratory() {
        return report(handed_over);
    }
    let result = match Cli::parse().command {
        Command::Encode(args) => encode::run(&args),
        Command::Decode(args) => decode::run(&args),
        Command::Split(args) => split::run(&args),
        Command::Join(args) => join::run(&args),
        Command::Key(args) => key::run(&args),
        Command::Link(args) => link::run(&args, &link::LabArgs::default()),
        #[cfg(feature = "console")]
        Command::Vehicle(args) => vehicle::run(&args),
        #[cfg(feature = "console")]
        Command::Channel(args) => channel::run(&args),
        #[cfg(feature = "console")]
        Command::Console(args) => console::run(&args),
        Command::Render(args) => render::run(&args),
        Command::Inspect(args) => inspect::run(&args),
        Command::Map(args) => map::run(&args),
        Command::Import(args) => import::run(&args),
        Command::Prior(command) => prior::run(&command),
        Command::KeyFrames(args) => prior::key_frames::run(&args),
        Command::Demo(args) => demo::run(&args),
        Command::DemoTopside(args) => demo::serve(&args),
        Command::Devices(args) => return report(devices::run(&args)),
    };
    report(result.map(|()| ExitCode::SUCCESS))
}

/// The exit code; names what failed.
fn report(result: anyhow::Result<ExitCode>) -> ExitCode {
    let code = result.unwrap_or_else(|error| {
        tell!("nvsprior: {error:#}");
        if error.is::<WrongUsage>() { ExitCode::from(2) } else { ExitCode::FAILURE }
    });
    if untold() > 0 {
        tell!("nvsprior: {} lines could not be written to standard output or error", untold());
    }
    code
}
