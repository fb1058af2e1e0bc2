//! `nvsprior prior`: what is done to a prior once it is trained.

mod blocks;
mod doubt;
mod filter;
pub mod key_frames;
mod tables;
mod trim;

use clap::Subcommand;

/// Work on a prior: make it smaller, or give it what coding, searching and showing take from it
#[derive(Subcommand)]
pub enum Command {
    Trim(trim::Args),
    Blocks(blocks::Args),
    KeyFrames(key_frames::Args),
    Tables(tables::Args),
    Filter(filter::Args),
    Doubt(doubt::Args),
}

pub fn run(command: &Command) -> anyhow::Result<()> {
    match command {
        Command::Trim(args) => trim::run(args),
        Command::Blocks(args) => blocks::run(args),
        Command::KeyFrames(args) => key_frames::run(args),
        Command::Tables(args) => tables::run(args),
        Command::Filter(args) => filter::run(args),
        Command::Doubt(args) => doubt::run(args),
    }
}
