//! `nvsprior`: encodes frames against a prior, decodes packets, renders, inspects, measures.

#[macro_use]
extern crate nvsprior_inputs;

mod blocks;
mod container;
mod decode;
mod demo;
mod device_report;
mod devices;
mod doubt;
mod encode;
mod filter;
mod import;
mod inspect;
mod join;
mod key;
mod key_frames;
mod keyed_files;
mod map;
mod mapping_run;
mod mission;
mod picture_renderer;
mod prior_file;
mod record;
mod render;
mod split;
mod summary;
mod tables;
mod trim;
mod view_set;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use nvsprior_console::{channel, console, vehicle};
use nvsprior_inputs::values::WrongUsage;
use nvsprior_lab::{bench, link, stability, verify_device};

/// Prints a line of a report: a name, and what there is to say of it.
fn row(name: &str, value: String) {
    println!("{name:14} {value}");
}

/// Pictures through an acoustic modem: image compression against a 3D Gaussian Splatting prior.
///
/// Vehicle and topside hold the same trained scene. For each frame, `encode` finds the pose at which the scene looks
/// most like the frame. It writes the pose with a coded difference picture to a packet. `decode` renders the scene at
/// that pose and adds the difference.
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
    Vehicle(vehicle::Args),
    Channel(channel::Args),
    Console(console::Args),
    Render(render::Args),
    Inspect(inspect::Args),
    Map(map::Args),
    Trim(trim::Args),
    Blocks(blocks::Args),
    Import(import::Args),
    KeyFrames(key_frames::Args),
    Tables(tables::Args),
    Filter(filter::Args),
    Doubt(doubt::Args),
    Bench(bench::Args),
    Demo(demo::Args),
    #[command(hide = true, name = nvsprior_demo::topside::TOPSIDE)]
    DemoTopside(demo::TopsideArgs),
    Devices(devices::Args),
    Stability(stability::Args),
    VerifyDevice(verify_device::Args),
    DeviceReport(device_report::Args),
}

fn main() -> ExitCode {
    // If a reader closes the pipe (`| head`), the program ends without a panic.
    sigpipe::reset();
    let result = match Cli::parse().command {
        Command::Encode(args) => encode::run(&args),
        Command::Decode(args) => decode::run(&args),
        Command::Split(args) => split::run(&args),
        Command::Join(args) => join::run(&args),
        Command::Key(args) => key::run(&args),
        Command::Link(args) => link::run(&args),
        Command::Vehicle(args) => vehicle::run(&args),
        Command::Channel(args) => channel::run(&args),
        Command::Console(args) => console::run(&args),
        Command::Render(args) => render::run(&args),
        Command::Inspect(args) => inspect::run(&args),
        Command::Map(args) => map::run(&args),
        Command::Trim(args) => trim::run(&args),
        Command::Blocks(args) => blocks::run(&args),
        Command::Import(args) => import::run(&args),
        Command::KeyFrames(args) => key_frames::run(&args),
        Command::Tables(args) => tables::run(&args),
        Command::Filter(args) => filter::run(&args),
        Command::Doubt(args) => doubt::run(&args),
        Command::Bench(args) => bench::run(&args, nvsprior_demo::prior::shipped),
        Command::Demo(args) => demo::run(&args),
        Command::DemoTopside(args) => demo::serve(&args),
        Command::Devices(args) => devices::run(&args),
        Command::Stability(args) => stability::run(&args),
        Command::VerifyDevice(args) => return report(verify_device::run(&args)),
        Command::DeviceReport(args) => return report(device_report::run(&args)),
    };
    report(result.map(|()| ExitCode::SUCCESS))
}

/// The exit code; names what failed.
fn report(result: anyhow::Result<ExitCode>) -> ExitCode {
    result.unwrap_or_else(|error| {
        tell!("nvsprior: {error:#}");
        if error.is::<WrongUsage>() { ExitCode::from(2) } else { ExitCode::FAILURE }
    })
}
