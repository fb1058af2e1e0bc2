//! `nvsprior-lab paper`: the paper's system on its own, BFGS or Adam with WebP, and its tables.

mod decode;
mod encode;

use clap::Subcommand;

use crate::bench::paper as tables;

/// The paper's system: encode, decode, and its tables
#[derive(Subcommand)]
pub enum Command {
    Encode(encode::Args),
    Decode(decode::Args),
    Bench(tables::Args),
}

pub fn run(command: &Command) -> anyhow::Result<()> {
    match command {
        Command::Encode(args) => encode::run(args),
        Command::Decode(args) => decode::run(args),
        Command::Bench(args) => tables::run(args),
    }
}
