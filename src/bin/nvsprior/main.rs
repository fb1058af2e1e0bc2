//! The command-line tool.

mod demo;

fn main() {}
